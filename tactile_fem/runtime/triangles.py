"""Triangulated surfaces: vertices and corners of triangles, and what is computed from these."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Points = NDArray[np.float64]
Indices = NDArray[np.int64]

# A second or two; libigl builds its trees anew for each part, at most a second of that.
_CHUNK_POINTS = 50_000


@dataclass(frozen=True)
class Triangles:
    """A triangulated surface, open or closed: vertices (n, 3) in mm, and corners (m, 3).

    Each vertex is used, and no two are equal; no triangle is degenerate.
    """

    points: Points
    triangles: Indices

    @property
    def corners(self) -> Points:
        """Coordinates of the triangles' corners, (m, 3, 3)."""
        return self.points[self.triangles]

    @property
    def area_vectors(self) -> Points:
        """Normals of the triangles, as long as their areas in mm^2, (m, 3)."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.cross(b - a, c - a) / 2

    @property
    def areas(self) -> Points:
        """Areas of the triangles, (m,) mm^2."""
        return np.linalg.norm(self.area_vectors, axis=1)

    def facing(self, directions: Points) -> Triangles:
        """Return the surface with triangles turned that face against directions (m, 3)."""
        against = np.einsum("ij,ij->i", self.area_vectors, directions) < 0
        return Triangles(
            self.points, np.where(against[:, None], self.triangles[:, [0, 2, 1]], self.triangles)
        )

    def moved(self, by: Points) -> Triangles:
        """Return the surface moved by (3,) mm."""
        return Triangles(self.points + by, self.triangles)

    def part(self, kept: NDArray[np.bool_]) -> Triangles:
        """Return some triangles (m,) and their vertices; itself if it is all of them."""
        if kept.all():
            return self
        used, flat = np.unique(self.triangles[kept], return_inverse=True)
        return Triangles(self.points[used], flat.reshape(-1, 3).astype(np.int64))

    def edges(self) -> Indices:
        """Return the directed edges (3 m, 2) of all triangles."""
        following = np.roll(self.triangles, -1, axis=1)
        return np.stack([self.triangles, following], axis=-1).reshape(-1, 2)

    def outwards(self) -> Triangles:
        """Return the surface facing outwards on the whole; itself if it does."""
        a, b, c = np.moveaxis(self.points[self.triangles] - self.points.mean(axis=0), 1, 0)
        if np.einsum("ni,ni->", a, np.cross(b, c)) > 0:
            return self
        return Triangles(self.points, self.triangles[:, ::-1].copy())


def in_chunks(evaluate: Callable[[Points], Sequence[Array]], points: Points) -> tuple[Array, ...]:
    """Return what a function returns for points (n, d), arrays (n, ...), evaluated in parts.

    Signals are answered between the parts.
    """
    starts = range(0, max(len(points), 1), _CHUNK_POINTS)
    parts = [evaluate(points[start : start + _CHUNK_POINTS]) for start in starts]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))
