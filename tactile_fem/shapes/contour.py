"""Level sets of a distance on a lattice as triangles that keep sharp edges.

Dual contouring with Hermite data (Ju et al. 2002, DOI 10.1145/566654.566586): each cell that the
level set crosses has one vertex, where the tangent planes known at its corners meet best.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tactile_fem.shapes.surface_files import Array, Triangles

_CORNERS = np.array(list(product((0, 1), repeat=3)))
# Pairs of corners one step apart.
_EDGES = np.array([(i, i + 4 // 2**a) for a in range(3) for i in range(8) if not _CORNERS[i, a]])
# Planes of a cell that turn by less than some 10 degrees are a curved surface, not an edge: the
# vertex then stays in their middle. Regularizes the eigenvalues of the sum of n n over 8 corners.
_EDGE_EIGENVALUE = 0.05


@dataclass(frozen=True)
class Lattice:
    """A regular grid of points in space, from `origin` (3,) in steps, in mm."""

    origin: Array
    step: float
    shape: tuple[int, int, int]

    @property
    def end(self) -> Array:
        """Return the last point, (3,) mm."""
        return self.origin + self.step * (np.array(self.shape) - 1)

    def points(self, flat: NDArray[np.int64]) -> Array:
        """Return the points (n, 3) of flat indices (n,)."""
        return self.origin + self.step * np.column_stack(np.unravel_index(flat, self.shape))

    def spread(self, places: Array) -> Array:
        """Return how far each point is from places (n, 3), mm; wrong by a step at most."""
        index = np.round((places - self.origin) / self.step).astype(np.int64)
        index = index[np.all((index >= 0) & (index < self.shape), axis=1)]
        free = np.ones(self.shape, dtype=bool)
        free[tuple(index.T)] = False
        return ndimage.distance_transform_edt(free, sampling=self.step)


@dataclass(frozen=True)
class Near:
    """Distances on a lattice, known near a surface.

    `value` has the lattice's shape, in mm; where the distance is not known, only its side of the
    surface is. `gradient` are unit vectors (n, 3), and `row` the row of each point in them, flat;
    -1 where unknown.
    """

    lattice: Lattice
    value: Array
    gradient: Array
    row: NDArray[np.int64]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where the distance is known, on the lattice."""
        return (self.row >= 0).reshape(self.value.shape)

    def raised(self, by: float) -> Near:
        """Return distances larger by some mm: those to another level, while no edge is near."""
        return replace(self, value=self.value + by)


def level_set(near: Near, level: float) -> Triangles:
    """Return the surface on which a distance has a level."""
    lattice, row = near.lattice, near.row
    offset = near.value.ravel() - level
    below = (offset < 0).reshape(lattice.shape)
    corners = [
        below[tuple(slice(c, n - 1 + c) for c, n in zip(corner, below.shape, strict=True))]
        for corner in _CORNERS
    ]
    mixed = np.any(corners, axis=0) & ~np.all(corners, axis=0)
    cell = np.flatnonzero(np.pad(mixed, [(0, 1)] * 3))  # by its first corner
    strides = np.array([lattice.shape[1] * lattice.shape[2], lattice.shape[2], 1])
    node = cell[:, None] + _CORNERS @ strides
    complete = np.all(row[node] >= 0, axis=1)
    cell, node = cell[complete], node[complete]
    vertex_of = np.full(offset.size, -1)
    vertex_of[cell] = np.arange(len(cell))
    points = _vertices(lattice, cell, node, offset, near.gradient[row[node]])
    return Triangles(points, _faces(below, vertex_of.reshape(lattice.shape)))


def _vertices(
    lattice: Lattice, cell: NDArray[np.int64], node: NDArray[np.int64], offset: Array, normal: Array
) -> Array:
    """Return where the planes of a cell's corners meet best, near the cell's crossings, (n, 3)."""
    corner = lattice.step * _CORNERS
    ends = offset[node][:, _EDGES]
    crossed = (ends[..., 0] < 0) != (ends[..., 1] < 0)
    share = np.where(crossed, ends[..., 0] / np.where(crossed, ends[..., 0] - ends[..., 1], 1), 0)
    crossing = corner[_EDGES[:, 0]] + share[..., None] * (
        corner[_EDGES[:, 1]] - corner[_EDGES[:, 0]]
    )
    mean = np.einsum("ne,nei->ni", crossed, crossing) / crossed.sum(axis=1)[:, None]
    feet = corner - offset[node][:, :, None] * normal
    behind = np.einsum("nki,nki->nk", normal, feet - mean[:, None])
    # The farther away a plane touches, the less it counts, in favour of curved surfaces.
    aside = np.linalg.norm(feet - mean[:, None], axis=2) / lattice.step
    weight = 1 / (0.01 + aside**4)
    weight *= 8 / weight.sum(axis=1, keepdims=True)
    size, axes = np.linalg.eigh(np.einsum("nk,nki,nkj->nij", weight, normal, normal))
    pull = np.einsum("nk,nk,nki,nij->nj", weight, behind, normal, axes)
    shift = np.einsum("nij,nj->ni", axes, pull * size / (size**2 + _EDGE_EIGENVALUE**2))
    return lattice.points(cell) + mean + np.clip(shift, -lattice.step, lattice.step)


def _faces(below: NDArray[np.bool_], vertex_of: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return two triangles for each edge of the lattice that crosses the level."""
    triangles = []
    for axis in range(3):
        ends = [np.moveaxis(below, axis, 0)[part] for part in (slice(0, -1), slice(1, None))]
        # The four cells around an edge, which needs neighbours on all sides.
        cells = np.moveaxis(vertex_of, axis, 0)[:-1]
        crossed = (ends[0] != ends[1])[:, 1:, 1:]
        low, high = slice(None, -1), slice(1, None)
        around = (low, low), (high, low), (high, high), (low, high)
        quad = np.column_stack([cells[:, a, b][crossed] for a, b in around])
        quad = quad[np.all(quad >= 0, axis=1)]
        triangles += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(triangles).astype(np.int64)
