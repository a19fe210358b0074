"""A measured surface."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field

from tactile_fem.runtime.files import cached_by_content
from tactile_fem.runtime.settings import File, Finite, NonNegative, Positive, nonzero
from tactile_fem.stimulus.body import Moved
from tactile_fem.stimulus.stimulus import Stimulus

if TYPE_CHECKING:
    from tactile_fem.stimulus.relief import Relief

_LEVELS = ["mean", "plane", "quadratic"]
_BEYOND: dict[str, Literal["mirror", "grid-wrap"]] = {"mirrored": "mirror", "periodic": "grid-wrap"}


class Surface(Stimulus):
    """A measured surface: heights over a plane, repeated without end."""

    kind: Literal["surface"] = "surface"
    file: File = Field(
        description="heights: .npy, .csv, .txt or .asc, a gray .png or .tif, .npz, .mat or .h5 of "
        "one array, or an instrument's file; rows follow each other along X, columns along Y; an "
        "instrument's x and y are X and Y"
    )
    spacing_mm: Positive | None = Field(
        None, description="between two values; default: as the file states"
    )
    unit_mm: Annotated[Finite, AfterValidator(nonzero)] | None = Field(
        None,
        description="height of one unit of the values, such as 0.001 for micrometres; negative if "
        "small values are high; default: as the file states",
    )
    crop_mm: tuple[NonNegative, NonNegative, Positive, Positive] | None = Field(
        None,
        description="the part to use: least X and Y, then largest, counted from the map's least; "
        "default: all",
    )
    level: Literal["mean", "plane", "quadratic"] = Field(
        "plane", description="what is subtracted: the mean, the plane or the paraboloid that fits"
    )
    low_pass_mm: NonNegative = Field(
        0.1,
        description="wavelength that a Gaussian filter (ISO 16610-61) halves; shorter waves vanish",
    )
    repeat: Literal["mirrored", "periodic"] = Field(
        "mirrored", description="beyond the map's edges: its mirror image, or the map again"
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

    def shape(self) -> Moved:
        """Return the surface, turned."""
        return Moved(self.relief(), angle=math.radians(self.turn_deg))
