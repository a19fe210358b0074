"""A rectangular grid of places, and what is read around places from values on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

Array = NDArray[Any]


@dataclass(frozen=True)
class Grid:
    """Places of equal spacing in X and Y.

    Attributes
    ----------
    low_mm
        Its first place, (2,).
    spacing_mm
        Both ways.
    shape
        Numbers of places in X and Y.
    """

    low_mm: tuple[float, float]
    spacing_mm: float
    shape: tuple[int, int]

    @classmethod
    def over(cls, low_mm: ArrayLike, high_mm: ArrayLike, spacing_mm: float) -> Self:
        """Return the grid that begins at one place and reaches another."""
        low, high = np.asarray(low_mm, dtype=float), np.asarray(high_mm, dtype=float)
        nx, ny = (int(n) for n in np.ceil((high - low) / spacing_mm - 1e-9) + 1)
        return cls((float(low[0]), float(low[1])), spacing_mm, (nx, ny))

    @cached_property
    def x_mm(self) -> Array:
        """Its places in X, (nx,)."""
        return self.low_mm[0] + self.spacing_mm * np.arange(self.shape[0])

    @cached_property
    def y_mm(self) -> Array:
        """Its places in Y, (ny,)."""
        return self.low_mm[1] + self.spacing_mm * np.arange(self.shape[1])

    @cached_property
    def points_mm(self) -> Array:
        """All its places, (nx * ny, 2); Y runs fastest."""
        return np.stack(np.meshgrid(self.x_mm, self.y_mm, indexing="ij"), axis=-1).reshape(-1, 2)

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
    k = spacing_mm * np.arange(-int(radius_mm / spacing_mm), int(radius_mm / spacing_mm) + 1)
    places = np.stack(np.meshgrid(k, k, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.hypot(*places.T)
    return places[(distance <= radius_mm + 1e-9) & (distance > beyond_mm)]
