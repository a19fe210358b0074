"""Where the receptors of a study lie, and what tissue they feel."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from tactile_fem.finger.plane import Plane
from tactile_fem.runtime.settings import Finite, NonNegative, Positive, Settings, Whole

_MAX_COUNT = 100_000
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
    spacing_mm: Positive = Field(0.2, description="of line and grid; paper's shift per pass")
    density_per_cm2: Positive = Field(
        70.0, description="of random and afferents; default that of SA1"
    )
    seed: Annotated[Whole, Field(ge=0)] = Field(1, description="of random and afferents")
    extra_mm: tuple[tuple[Finite, Finite], ...] = Field(
        (), description="further receptors: pairs X, Y"
    )
    below_skin_mm: Positive | None = Field(
        None,
        description="below the undeformed skin; default on the epidermis-dermis interface",
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
        1.0, description="proposed: of the circle on which the other end organs lie"
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
            count = max(count, self.density_per_cm2 * across * along / 100)
        if count > _MAX_COUNT:
            raise ValueError(
                f"{count:.3g} receptors are more than {_MAX_COUNT:,}; choose a smaller extent, a "
                "longer spacing_mm or a lower density_per_cm2"
            )
        return self

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
