"""A measured surface: its keys."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field

from tactile_fem.runtime.settings import File, Finite, NonNegative, Positive, nonzero
from tactile_fem.stimulus.stimulus import Stimulus

if TYPE_CHECKING:
    from tactile_fem.stimulus.relief import Relief, Turned

# A quadratic edge can take the shape of half a wave, within 6 % of its height.
_EDGES_PER_WAVE = 2
# Share of the variance that a sufficiently fine skin follows.
_SUFFICIENT_SHARE = 0.9


class Surface(Stimulus):
    """A measured surface: heights over a plane, repeated without end."""

    kind: Literal["surface"] = "surface"
    file: File = Field(
        description="heights: .npy, .csv, .txt or .asc, a gray .png or .tif, or an instrument's "
        "file; rows follow each other along X, columns along Y; an instrument's x and y are X and Y"
    )
    spacing_mm: Positive | None = Field(
        None, description="between two values; default as the file states"
    )
    unit_mm: Annotated[Finite, AfterValidator(nonzero)] | None = Field(
        None,
        description="height of one unit of the values, such as 0.001 for micrometres; negative if "
        "small values are high; default as the file states",
    )
    crop_mm: tuple[NonNegative, NonNegative, Positive, Positive] | None = Field(
        None,
        description="the part that is used, from its least X and Y to its largest, counted from "
        "those of the map; default all",
    )
    level: Literal["mean", "plane", "quadratic"] = Field(
        "plane", description="what is subtracted: the mean, the plane or the paraboloid that fits"
    )
    low_pass_mm: NonNegative = Field(
        0.1,
        description="wavelength that a Gaussian filter (ISO 16610-61) halves; shorter waves vanish",
    )
    repeat: Literal["mirrored", "periodic"] = Field(
        "mirrored", description="what follows beyond the file's edges: its mirror image, or itself"
    )
    turn_deg: Finite = Field(0.0, description="turn about Z through the middle, from X towards Y")

    def relief(self) -> Relief:
        """Return the levelled and filtered surface, not turned; cached as the body is."""
        from tactile_fem.stimulus.relief import make_relief  # takes a while

        return make_relief(self)

    def shape(self) -> Turned:
        """Return the surface, turned."""
        from tactile_fem.stimulus.relief import Turned

        return Turned(self.relief(), math.radians(self.turn_deg))

    def resolution(self, facet_mm: float, preset_facets_mm: Mapping[str, float]) -> str:
        """Return which part of the roughness skin with such facets follows, and which would."""
        from tactile_fem.stimulus.roughness import Roughness

        waves = Roughness.of(self.relief().heights)
        shares = {
            name: waves.share(_EDGES_PER_WAVE * edge) for name, edge in preset_facets_mm.items()
        }
        return (
            f"surface of {waves.rms_mm:.3g} mm rms: waves of {_EDGES_PER_WAVE * facet_mm:.2g} mm "
            "and more, twice the skin's facets, carry "
            f"{100 * waves.share(_EDGES_PER_WAVE * facet_mm):.0f} % of its variance, the skin "
            "cannot follow the others; preset "
            f"{', '.join(f'{name} {100 * share:.0f} %' for name, share in shares.items())}; "
            f"pad_size_mm = {waves.wavelength_of(_SUFFICIENT_SHARE) / _EDGES_PER_WAVE:.2g} would "
            f"follow {100 * _SUFFICIENT_SHARE:.0f} %"
        )
