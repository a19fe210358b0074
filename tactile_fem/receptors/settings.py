"""Where the receptors of a study lie, and what tissue they feel."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from tactile_fem.finger.plane import Plane
from tactile_fem.runtime.settings import Finite, NonNegative, Positive, Settings, Whole

_MAX_COUNT = 100_000
_PHALANX_MM2 = 1000.0  # about its skin
# Placements at tips of the epidermis-dermis interface, in a section.
TIPS = ("intermediate_ridges", "papillae")


class Receptors(Settings):
    """End organs on the epidermis-dermis interface or anywhere below the skin."""

    placement: Literal["line", "grid", "random", "afferents", "intermediate_ridges", "papillae"] = (
        Field(
            "line",
            description="paper: a line across the finger (in a section, along it); or a grid, at "
            "random, or like afferents: by density on the interface, none close to another; in a "
            "section also at the tips of its intermediate ridges (SA1) or of its papillae (RA)",
        )
    )
    half_width_mm: NonNegative = Field(5.0, description="extent across the finger (X)")
    half_length_mm: NonNegative = Field(
        4.0, description="extent along the finger (Y); a line has none"
    )
    spacing_mm: Positive = Field(0.2, description="of a line or grid; the paper's shift per pass")
    density_per_cm2: Positive = Field(
        70.0, description="of random and afferents; the default is that of SA1"
    )
    count: Annotated[Whole, Field(ge=1, le=_MAX_COUNT)] | None = Field(
        None, description="of random and afferents, instead of density_per_cm2"
    )
    region: Literal["pad", "phalanx", "nail_border"] = Field(
        "pad",
        description="of random and afferents: the pad within the extent above; phalanx: pad, "
        "sides and end; or the skin beside the nail",
    )
    nail_border_mm: Positive = Field(3.0, description="proposed: width of nail_border")
    seed: Annotated[Whole, Field(ge=0)] = Field(
        1, description="of random and afferents, and of all preferred directions"
    )
    extra_mm: tuple[tuple[Finite, Finite], ...] = Field(
        (), description="further receptors: pairs X, Y"
    )
    below_skin_mm: Positive | None = Field(
        None,
        description="below the undeformed skin; default: on the epidermis-dermis interface",
    )
    side: Literal["epidermis", "dermis", "subcutaneous"] = Field(
        "epidermis", description="tissue whose strain energy the receptor feels"
    )
    average_radius_mm: NonNegative = Field(
        0.25, description="proposed: radius of the averaged ball; 0 is the point value"
    )
    end_organs: Annotated[Whole, Field(ge=1, le=50)] = Field(
        1, description="paper: one; more are averaged, one at the receptor, the others around it"
    )
    end_organs_radius_mm: Positive = Field(
        1.0, description="proposed: radius of the circle on which the other end organs lie"
    )

    @model_validator(mode="after")
    def _are_few(self) -> Self:
        """Refuse far more receptors than a fingertip has."""
        across, along = 2 * self.half_width_mm, 2 * self.half_length_mm
        rows, columns = across / self.spacing_mm, along / self.spacing_mm
        count = max(rows, columns)  # both lines are laid out, whatever the placement
        if self.placement == "grid":
            count = max(count, rows * columns)
        elif self.placement in ("random", "afferents"):
            area = across * along if self.region == "pad" else _PHALANX_MM2
            count = max(count, self.number_on(area))
        if count > _MAX_COUNT:
            raise ValueError(
                f"{count:.3g} receptors are more than {_MAX_COUNT:,}; choose a smaller extent, a "
                "longer spacing_mm or a lower density_per_cm2"
            )
        return self

    @model_validator(mode="after")
    def _are_of_a_region(self) -> Self:
        """Refuse what is seen from below, elsewhere than on the pad."""
        if self.region != "pad":
            if self.placement not in ("random", "afferents"):
                raise ValueError(
                    f'region = "{self.region}" needs placement = "random" or "afferents"'
                )
            if self.end_organs > 1:
                raise ValueError(f'region = "{self.region}" needs end_organs = 1')
        return self

    def number_on(self, area_mm2: float) -> int:
        """Return how many receptors lie on an area, of random and afferents."""
        return self.count or max(1, round(self.density_per_cm2 * area_mm2 / 100))

    def shared_with(self, own: dict[str, Any]) -> dict[str, Any]:
        """Return the keys that a population inherits: all."""
        return self.model_dump()


def misplaced(receptors: Receptors, plane: Plane) -> str:
    """Return why receptors cannot be placed in a section, or in space; empty if they can."""
    placement = receptors.placement
    if plane.is_space:
        needed = 'finger.kind = "section" and finger.papilla_depth_mm'
        wrong = f'receptors.placement = "{placement}" needs a section with papillae: {needed}'
        return wrong if placement in TIPS else ""
    if receptors.end_organs > 1:
        return (
            f"receptors.end_organs = {receptors.end_organs} do not lie in the plane of a section: "
            "use 1"
        )
    if placement not in ("line", *TIPS):
        return (
            f'receptors.placement = "{placement}" does not lie in a section: '
            'use "line", "intermediate_ridges" or "papillae"'
        )
    return ""
