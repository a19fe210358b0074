"""A rigid body as the heights that a finger above it meets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem import RigidBody
from tactile_fem.errors import StudyError
from tactile_fem.stimulus import linear_between
from tactile_fem.surrogate.grid import Grid

Array = NDArray[Any]

FLOOR_MM = -3.0  # no finger reaches deeper below the highest plane of a body
_SPACING_MM, _NEAR_MM, _STEPS = 0.125, 2e-3, 80


@dataclass(frozen=True)
class HeightMap:
    """Heights of a body over its X and Y, seen from the finger.

    Attributes
    ----------
    grid
        Where they are, in the body's frame.
    heights_mm
        (nx, ny); the highest plane is 0, as that of a rigid body. Beyond the grid follow the
        heights at its border.
    """

    grid: Grid
    heights_mm: Array

    def __post_init__(self) -> None:
        """Refuse heights that do not fit the grid.

        Raises
        ------
        StudyError
            Another shape, or heights that are above 0 or not finite.
        """
        if np.shape(self.heights_mm) != self.grid.shape:
            raise StudyError(
                f"heights_mm has the shape {np.shape(self.heights_mm)} on a grid of "
                f"{self.grid.shape} places."
            )
        if not np.isfinite(self.heights_mm).all():
            raise StudyError("heights_mm: all heights must be finite.")
        if (top := np.max(self.heights_mm)) > _NEAR_MM:
            raise StudyError(f"heights_mm reach {top:g}; the highest plane of a body is 0.")

    @classmethod
    def of_array(cls, heights_mm: ArrayLike, spacing_mm: float) -> Self:
        """Return heights (nx, ny) about the body's origin, their highest raised or lowered to 0.

        Raises
        ------
        StudyError
            They are no table of two by two or more finite heights, or the spacing is not positive.
        """
        if np.ma.is_masked(heights_mm):
            raise StudyError("heights_mm: some heights are masked; fill them first.")
        heights = np.array(heights_mm, dtype=float)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise StudyError(f"heights_mm has the shape {heights.shape}; it needs (nx, ny).")
        if not (np.isfinite(spacing_mm) and spacing_mm > 0):
            raise StudyError(f"spacing_mm is {spacing_mm}; it must be positive.")
        low = -spacing_mm * (np.array(heights.shape) - 1) / 2
        nx, ny = heights.shape
        return cls(Grid((low[0], low[1]), spacing_mm, (nx, ny)), heights - heights.max())

    @classmethod
    def of(cls, body: RigidBody, low_mm: ArrayLike, high_mm: ArrayLike) -> Self:
        """Return the heights of a body between two places (2,) of its frame.

        Each is found from above: as a distance is never too long, steps of its length end on the
        body.
        """
        low = _SPACING_MM * np.floor(np.asarray(low_mm) / _SPACING_MM)  # so mirror images are alike
        grid = Grid.over(low, high_mm, _SPACING_MM)
        z, above = np.zeros(len(grid.points_mm)), np.arange(len(grid.points_mm))
        for _ in range(_STEPS):
            gap = body.distance(np.column_stack([grid.points_mm[above], z[above]])).gap
            z[above] -= np.maximum(gap, 0.0)
            above = above[(gap > _NEAR_MM) & (z[above] > FLOOR_MM)]
            if not len(above):
                break
        return cls(grid, np.maximum(z, FLOOR_MM).reshape(grid.shape))

    def over(self, grid: Grid, place_mm: Array) -> Array:
        """Return the heights (nx, ny) over a grid of space of the body at a place (2,)."""
        places = grid.points_mm - place_mm
        heights = linear_between(self.heights_mm, self.grid.low_mm, self.grid.spacing_mm, places)
        return heights.reshape(grid.shape)
