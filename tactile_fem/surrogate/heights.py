"""Heights of rigid bodies on grids, as a finger above them meets them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from tactile_fem import RigidBody
from tactile_fem.errors import StudyError
from tactile_fem.stimulus import linear_between

Array = NDArray[Any]


@dataclass(frozen=True)
class Grid:
    """Places of equal spacing in X and Y."""

    low_mm: tuple[float, float]  # its first place
    spacing_mm: float  # both ways
    shape: tuple[int, int]  # numbers of places in X and Y

    @classmethod
    def over(cls, low_mm: ArrayLike, high_mm: ArrayLike, spacing_mm: float) -> Self:
        """Return the grid that begins at one place and reaches another."""
        low, high = np.asarray(low_mm, dtype=float), np.asarray(high_mm, dtype=float)
        nx, ny = (int(n) for n in np.ceil((high - low) / spacing_mm - 1e-9) + 1)
        return cls((float(low[0]), float(low[1])), spacing_mm, (nx, ny))

    @cached_property
    def points_mm(self) -> Array:
        """All its places, (nx * ny, 2); Y runs fastest."""
        steps = np.moveaxis(np.indices(self.shape), 0, -1).reshape(-1, 2)
        return self.low_mm + self.spacing_mm * steps

    def means(self, places_mm: Array, half_mm: float) -> sparse.csr_array:
        """Return the matrix (places, nx * ny) of means about places (n, 2).

        The weights of a mean are a hat in X times one in Y, of half width `half_mm`, which is at
        least the spacing; with the spacing itself the mean interpolates. Outside of the grid the
        values count as zero.
        """
        across = round(half_mm / self.spacing_mm)
        steps = np.arange(-across, across + 1)
        columns, weights = [], []
        for k, size in enumerate(self.shape):
            at = (places_mm[:, k] - self.low_mm[k]) / self.spacing_mm
            index = np.round(at).astype(int)[:, None] + steps
            hat = np.maximum(0.0, 1 - np.abs(index - at[:, None]) / across)
            hat /= hat.sum(axis=1, keepdims=True)
            hat[(index < 0) | (index >= size)] = 0.0
            columns.append(np.clip(index, 0, size - 1))
            weights.append(hat)
        column = columns[0][:, :, None] * self.shape[1] + columns[1][:, None, :]
        weight = weights[0][:, :, None] * weights[1][:, None, :]
        row = np.broadcast_to(np.arange(len(places_mm))[:, None, None], column.shape)
        entries = weight.ravel(), (row.ravel(), column.ravel())
        matrix = sparse.csr_array(entries, shape=(len(places_mm), self.shape[0] * self.shape[1]))
        matrix.sum_duplicates()
        matrix.eliminate_zeros()
        return matrix.astype(np.float32)


def disc(spacing_mm: float, radius_mm: float, beyond_mm: float = -1.0) -> Array:
    """Return the places (n, 2) of a grid about 0 that lie within one radius and beyond another."""
    k = int(radius_mm / spacing_mm)
    places = Grid((-k * spacing_mm, -k * spacing_mm), spacing_mm, (2 * k + 1, 2 * k + 1)).points_mm
    distance = np.hypot(*places.T)
    return places[(distance <= radius_mm + 1e-9) & (distance > beyond_mm)]


FLOOR_MM = -3.0  # no finger reaches deeper below the highest plane of a body
_SPACING_MM, _NEAR_MM, _STEPS = 0.125, 2e-3, 80


@dataclass(frozen=True)
class HeightMap:
    """Heights of a body over its X and Y, seen from the finger.

    Attributes
    ----------
    grid
        Grid in the body's frame.
    heights_mm
        (nx, ny); the highest plane is 0, as that of a rigid body. Beyond the grid follow the
        heights at its border.
    """

    grid: Grid
    heights_mm: Array

    def __post_init__(self) -> None:
        """Raise StudyError for heights of another shape, above 0, or not finite."""
        if (shape := np.shape(self.heights_mm)) != self.grid.shape:
            raise StudyError(f"heights_mm has the shape {shape} on a grid of {self.grid.shape}.")
        if not np.isfinite(self.heights_mm).all():
            raise StudyError("heights_mm: all heights must be finite.")
        if (top := np.max(self.heights_mm)) > _NEAR_MM:
            raise StudyError(f"heights_mm reach {top:g}; the highest plane of a body is 0.")

    @classmethod
    def of_array(cls, heights_mm: ArrayLike, spacing_mm: float) -> Self:
        """Return heights (nx, ny) about the body's origin, their highest raised or lowered to 0.

        Raises StudyError if they are no table of two by two or more finite heights, or the spacing
        is not positive.
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
