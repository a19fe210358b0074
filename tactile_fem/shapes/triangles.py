"""Triangulated surfaces from files, and what is computed from their vertices and corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.simplex import Indices
from tactile_fem.finger.simplex import Triangles as Surface

Array = NDArray[Any]
Points = NDArray[np.float64]

# A second or two; libigl builds its trees anew for each part, at most a second of that.
_CHUNK_POINTS = 50_000


@dataclass(frozen=True)
class Triangles(Surface):
    """A surface of which each vertex is used, no two are equal, and no triangle is degenerate."""

    @property
    def areas(self) -> Points:
        """Areas of the triangles, (m,) mm^2."""
        return np.linalg.norm(self.area_vectors, axis=1)

    def moved(self, by: Points) -> Self:
        """Return the surface moved by (3,) mm."""
        return replace(self, points=self.points + by)

    def part(self, kept: NDArray[np.bool_]) -> Self:
        """Return some triangles (m,) and their vertices; itself if it is all of them."""
        if kept.all():
            return self
        used, flat = np.unique(self.triangles[kept], return_inverse=True)
        return replace(self, points=self.points[used], triangles=flat.reshape(-1, 3))

    def edges(self) -> Indices:
        """Return the directed edges (3 m, 2) of all triangles."""
        following = np.roll(self.triangles, -1, axis=1)
        return np.stack([self.triangles, following], axis=-1).reshape(-1, 2)

    def outwards(self) -> Self:
        """Return the surface facing outwards on the whole; itself if it does."""
        a, b, c = np.moveaxis(self.points[self.triangles] - self.points.mean(axis=0), 1, 0)
        if np.einsum("ni,ni->", a, np.cross(b, c)) > 0:
            return self
        return replace(self, triangles=self.triangles[:, ::-1].copy())


def in_chunks(evaluate: Callable[[Points], Sequence[Array]], points: Points) -> tuple[Array, ...]:
    """Return what a function returns for points (n, d), arrays (n, ...), evaluated in parts.

    Signals are answered between the parts.
    """
    starts = range(0, max(len(points), 1), _CHUNK_POINTS)
    parts = [evaluate(points[start : start + _CHUNK_POINTS]) for start in starts]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))
