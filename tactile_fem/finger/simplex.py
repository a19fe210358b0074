"""Tetrahedra and triangles: their nodes, facets, size and quality, linear or quadratic."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.plane import Array

Indices = NDArray[np.int64]

# Barycentric tolerance of a point in a facet, and how far off the plane of a section it may lie.
_TOLERANCE, _IN_PLANE_MM = 1e-9, 1e-6
_CANDIDATES = 12  # facets with the nearest centres, of which one is the nearest


@dataclass(frozen=True)
class Triangles:
    """A triangulated surface, open or closed: vertices (n, 3) in mm, and corners (m, 3)."""

    points: Array
    triangles: Indices

    @property
    def corners(self) -> Array:
        """Coordinates of the triangles' corners, (m, 3, 3)."""
        return self.points[self.triangles]

    @property
    def area_vectors(self) -> Array:
        """Normals of the triangles, as long as their areas in mm^2, (m, 3)."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.cross(b - a, c - a) / 2

    def facing(self, directions: Array) -> Self:
        """Return the surface with triangles turned that face against directions (m, 3)."""
        against = np.einsum("ij,ij->i", self.area_vectors, directions) < 0
        turned = np.where(against[:, None], self.triangles[:, [0, 2, 1]], self.triangles)
        return replace(self, triangles=turned)


@dataclass(frozen=True)
class Simplex:
    """The cells of one dimension; their nodes are in the order of gmsh."""

    dim: int
    edges: Indices  # (e, 2) corners of the edges, which carry the mid-nodes
    facets: Indices  # (corners, dim) corners of the facets, oriented outwards
    facet_edges: Indices  # edges of a facet
    vtk_order: list[int]  # position of each of VTK's nodes
    meshio: str  # name of the quadratic cell
    meshio_facet: str
    plural: str
    measure: str  # name of the size

    @property
    def corners(self) -> int:
        """Number of corners of a cell."""
        return self.dim + 1

    def gradients(self, weights: Array) -> Array:
        """Return the gradients (nodes, dim) of the quadratic shape functions.

        They are those at a point with barycentric coordinates `weights` (corners,).
        """
        linear = np.vstack([-np.ones(self.dim), np.eye(self.dim)])
        one, other = self.edges.T
        at_corners = (4 * weights - 1)[:, None] * linear
        at_middles = weights[one, None] * linear[other] + weights[other, None] * linear[one]
        return np.vstack([at_corners, 4 * at_middles])


_TRIANGLE = np.array([[0, 1], [1, 2], [2, 0]])
SOLID = Simplex(
    dim=3,
    edges=np.array([[0, 1], [1, 2], [2, 0], [3, 0], [2, 3], [1, 3]]),
    facets=np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]),
    facet_edges=_TRIANGLE,
    vtk_order=[0, 1, 2, 3, 4, 5, 6, 7, 9, 8],  # so in meshio, CalculiX and Abaqus, too
    meshio="tetra10",
    meshio_facet="triangle6",
    plural="tetrahedra",
    measure="volume",
)
FLAT = Simplex(
    dim=2,
    edges=_TRIANGLE,
    facets=_TRIANGLE,
    facet_edges=np.array([[0, 1]]),
    vtk_order=[*range(6)],
    meshio="triangle6",
    meshio_facet="line3",
    plural="triangles",
    measure="area",
)


def simplex_of(cells: Indices) -> Simplex:
    """Return the shape of cells with (m, 4) or (m, 10) nodes, tetrahedra, or (m, 3) or (m, 6)."""
    return SOLID if cells.shape[1] in (4, 10) else FLAT


def facets_of(cells: Indices) -> tuple[Indices, Indices, Indices]:
    """Find the facets of tetrahedra or triangles, linear or quadratic.

    Return their corners (f, 3) or (f, 2), oriented outwards from their first cell (f,), that cell,
    and the one on the other side (f,), -1 on the boundary. Raises ValueError if a facet belongs to
    more than two cells.
    """
    shape = simplex_of(cells)
    corners = cells[:, shape.facets].reshape(-1, shape.dim)
    _, start, group, count = np.unique(
        np.sort(corners, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    if count.max() > 2:
        raise ValueError(f"a facet belongs to more than two {shape.plural}")
    total = np.zeros(len(start), dtype=np.int64)
    owner = np.repeat(np.arange(len(cells)), shape.corners)
    np.add.at(total, group.reshape(-1), owner)
    first = owner[start]
    second = np.where(count == 2, total - first, -1)
    return corners[start], first, second


def quadratic(nodes: Array, cells: Indices, facets: Indices) -> tuple[Array, Indices, Indices]:
    """Add midpoints: linear cells and facets become straight quadratic ones.

    Return nodes, cells and facets; corners come first and keep their numbers. Coordinates are
    rounded to 1e-8 mm (midpoints 1e-9), which keeps files short.
    """
    shape = simplex_of(cells)
    nodes = np.round(nodes, 8)
    edges = np.sort(cells[:, shape.edges].reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    middle = number.reshape(len(cells), -1) + len(nodes)
    key = unique[:, 0] * len(nodes) + unique[:, 1]
    sides = np.sort(facets[:, shape.facet_edges], axis=2)
    sides = np.searchsorted(key, sides[..., 0] * len(nodes) + sides[..., 1]) + len(nodes)
    return (
        np.vstack([nodes, np.round(nodes[unique].mean(axis=1), 9)]),
        np.hstack([cells, middle]),
        np.hstack([facets, sides]),
    )


def _edges(nodes: Array, cells: Indices) -> Array:
    """Return the edges (m, d, d) from the first corner of each cell to the others."""
    dim = nodes.shape[1]
    return nodes[cells[:, 1 : dim + 1]] - nodes[cells[:, :1]]


def volumes(nodes: Array, cells: Indices) -> Array:
    """Return signed volumes (m,) of tetrahedra, nodes (n, 3), or areas of triangles, (n, 2)."""
    return np.linalg.det(_edges(nodes, cells)) / math.factorial(nodes.shape[1])


def gammas(nodes: Array, cells: Indices) -> Array:
    """Return the quality gamma of gmsh (m,): d times inradius over circumradius, 1 if regular."""
    edges = _edges(nodes, cells)
    # Barycentric coordinates grow by 1 over a height: 1 over the sum of slopes is the inradius.
    slopes = np.linalg.inv(edges)
    slopes = np.concatenate([slopes, -slopes.sum(axis=2, keepdims=True)], axis=2)
    to_centre = np.linalg.solve(2 * edges, np.sum(edges**2, axis=2, keepdims=True))[..., 0]
    steepness = np.linalg.norm(slopes, axis=1).sum(axis=1)
    return nodes.shape[1] / (steepness * np.linalg.norm(to_centre, axis=1))


def jacobians(nodes: Array, cells: Indices) -> Array:
    """Return the determinants (m, nodes) of the quadratic map at the nodes of each cell."""
    shape = simplex_of(cells)
    corners = np.eye(shape.corners)
    barycentric = np.vstack([corners, corners[shape.edges].mean(axis=1)])
    maps = [np.einsum("mni,nj->mij", nodes[cells], shape.gradients(w)) for w in barycentric]
    return np.linalg.det(np.array(maps)).T


def distances(points: Array, facets: Array) -> Array:
    """Return the distances (n,) from points (n, 3) to triangles (m, 3, 3) or lines (m, 2, 3)."""
    return np.linalg.norm(closest_points(points, facets) - points, axis=1)


def closest_points(points: Array, facets: Array) -> Array:
    """Return the points (n, 3) of triangles (m, 3, 3) or lines (m, 2, 3) closest to points."""
    from scipy.spatial import cKDTree  # takes 0.3 s
    from trimesh.triangles import closest_point  # takes 0.15 s

    count = min(_CANDIDATES, len(facets))
    _, near = cKDTree(facets.mean(axis=1)).query(points, k=count)
    triangles = facets[near.ravel()][:, [0, 1, -1]]  # of a line the second corner is repeated
    each = np.repeat(points, count, axis=0)
    found = closest_point(triangles, each).reshape(-1, count, 3)
    best = np.linalg.norm(found - points[:, None], axis=2).argmin(axis=1)
    return found[np.arange(len(points)), best]


def lowest_facet(x: float, y: float, facets: Array) -> tuple[int, Array] | None:
    """Return the lowest facet over or under a point of the XY plane, None if there is none.

    `facets` are (m, 3, 3) corners of triangles or (m, 2, 3) of lines in an upright plane. The facet
    is given by its index and the barycentric coordinates (3,) or (2,) in it.
    """
    weights = _barycentric(np.array([x, y]), facets[..., :2])
    inside = np.flatnonzero(np.all(weights >= -_TOLERANCE, axis=1))
    if not len(inside):
        return None
    height = np.einsum("mi,mi->m", weights[inside], facets[inside, :, 2])
    lowest = int(inside[np.argmin(height)])
    return lowest, weights[lowest]


def lowest_height(x: float, y: float, facets: Array) -> float | None:
    """Return the Z at which the line through (x, y) meets its lowest facet; None if it misses."""
    found = lowest_facet(x, y, facets)
    return None if found is None else float(found[1] @ facets[found[0], :, 2])


def _barycentric(point: Array, facets: Array) -> Array:
    """Return coordinates of a point in facets of the XY plane, -1 where it has none."""
    corner, edges = facets[:, 0], facets[:, 1:] - facets[:, :1]
    p = point - corner
    if edges.shape[1] == 1:
        along = edges[:, 0]
        square = np.sum(along**2, axis=1)
        t = np.sum(p * along, axis=1) / np.where(square == 0, np.inf, square)
        aside = np.abs(p - t[:, None] * along).max(axis=1)
        found, valid = np.column_stack([1 - t, t]), (square > 0) & (aside < _IN_PLANE_MM)
    else:
        (a, b), (c, d) = edges[:, :, 0].T, edges[:, :, 1].T
        det = a * d - b * c
        safe = np.where(det == 0, np.inf, det)
        second = (d * p[:, 0] - b * p[:, 1]) / safe
        third = (a * p[:, 1] - c * p[:, 0]) / safe
        found, valid = np.column_stack([1 - second - third, second, third]), det != 0
    return np.where(valid[:, None], found, -1.0)
