"""A measured surface."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field

from tactile_fem.runtime.files import cached_by_content
from tactile_fem.runtime.settings import File, Finite, NonNegative, Positive, nonzero
from tactile_fem.stimulus.body import Turned
from tactile_fem.stimulus.stimulus import Stimulus

if TYPE_CHECKING:
    from tactile_fem.stimulus.relief import Relief

_LEVELS = ["mean", "plane", "quadratic"]
_BEYOND: dict[str, Literal["mirror", "grid-wrap"]] = {"mirrored": "mirror", "periodic": "grid-wrap"}
# A quadratic edge can take the shape of half a wave, within 6 % of its height.
_EDGES_PER_WAVE = 2
# Share of the variance that a sufficiently fine skin follows.
_SUFFICIENT_SHARE = 0.9


class Surface(Stimulus):
    """A measured surface: heights over a plane, repeated without end."""

    smoother_by = ("low_pass_mm",)
    kind: Literal["surface"] = "surface"
    file: File = Field(
        description="heights: .npy, .csv, .txt or .asc, a gray .png or .tif, .npz, .mat or .h5 of "
        "one array, or an instrument's file; rows follow each other along X, columns along Y; an "
        "instrument's x and y are X and Y"
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

    @cached_by_content(maxsize=4)
    def relief(self) -> Relief:
        """Return the levelled and filtered surface, not turned; cached as the body is.

        Raises
        ------
        StudyError
            The file cannot be used, or no finger can touch such a surface.
        """
        from tactile_fem.stimulus.relief import Relief, levelled  # SciPy takes a while
        from tactile_fem.stimulus.topography import check_relief, read_topography

        found = read_topography(self.file, self.spacing_mm, self.unit_mm, self.crop_mm)
        heights = levelled(found.heights_mm, _LEVELS.index(self.level))
        check_relief(heights, self.file)
        return Relief.of(heights, found.spacing_mm, self.low_pass_mm, _BEYOND[self.repeat])

    def shape(self) -> Turned:
        """Return the surface, turned."""
        return Turned(self.relief(), math.radians(self.turn_deg))

    def hindrance(self, facet_mm: float) -> str:
        """Return where the surface is too steep and sharp for such facets, and what helps."""
        from tactile_fem.stimulus import sharpness

        relief, limits = self.relief(), sharpness.Limits.of_facets(facet_mm)
        edge = sharpness.sharpest_edge(relief, limits)
        if edge is None:
            return ""
        low_pass_mm = sharpness.low_pass_that_helps(relief, self.low_pass_mm, limits)
        factor = sharpness.factor_that_helps(relief, limits)
        lower = f"heights {sharpness.two_digits(factor):g} times as large"
        if self.unit_mm is not None:
            unit_mm = math.copysign(sharpness.two_digits(factor * abs(self.unit_mm)), self.unit_mm)
            lower = f"unit_mm = {unit_mm:g} (now {self.unit_mm:.3g})"
        x, y = self.shape().matrix[:2, :2] @ edge.place_mm + self.shift_mm
        return (
            f"the surface is steep at X {x:.2f}, Y {y:.2f} mm (at displacement 0): "
            f"{edge.angle_deg:.0f} degrees, beside an edge whose radius is {edge.radius_mm:.2g} "
            f"mm, while the skin's facets of {facet_mm:.2g} mm need {limits.radius_mm:.2g} mm; the "
            f"scan may take long or diverge: choose stimulus.low_pass_mm = {low_pass_mm:g} (now "
            f"{self.low_pass_mm:g})"
            + (', for flat shapes stimulus.kind = "drawing"' if edge.is_flat else "")
            + f", or, which helps less, {lower}"
        )

    def resolution(self, facet_mm: float, preset_facets_mm: Mapping[str, float]) -> str:
        """Return which part of the roughness skin with such facets follows, and which would."""
        from tactile_fem.stimulus.relief import Roughness

        waves = Roughness.of(self.relief().heights)

        def percent(edge_mm: float) -> str:
            return f"{100 * waves.share(_EDGES_PER_WAVE * edge_mm):.0f} %"

        return (
            f"surface of {waves.rms_mm:.3g} mm rms: waves of {_EDGES_PER_WAVE * facet_mm:.2g} mm "
            f"and more, twice the skin's facets, carry {percent(facet_mm)} of its variance, the "
            "skin cannot follow the others; preset "
            f"{', '.join(f'{name} {percent(edge)}' for name, edge in preset_facets_mm.items())}; "
            f"pad_size_mm = {waves.wavelength_of(_SUFFICIENT_SHARE) / _EDGES_PER_WAVE:.2g} would "
            f"follow {100 * _SUFFICIENT_SHARE:.0f} %"
        )
