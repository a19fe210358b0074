"""The mesh of a finger as plain arrays, and the tags of its parts."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.plane import SPACE, Plane

TISSUES = {
    "stratum_corneum": 1,
    "epidermis": 2,
    "dermis": 3,
    "subcutaneous": 4,
    "bone": 5,
    "nail": 6,
}
SURFACES = {"skin": 11, "interface": 12, "bone_surface": 13, "cut": 14}

# Corners of the facet opposite to each corner, oriented outwards.
TET_FACETS = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
# Corners of the edges that carry the mid-nodes of tetrahedra, triangles and lines, gmsh's order.
TET_EDGES = np.array([[0, 1], [1, 2], [2, 0], [3, 0], [2, 3], [1, 3]])
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
LINE_EDGES = np.array([[0, 1]])
# In VTK, meshio, CalculiX and Abaqus the last two mid-nodes of a tetrahedron are swapped.
VTK_ORDER = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
# Tolerance in barycentric coordinates for a point inside a facet.
_EDGE = 1e-9
# So far off its plane a point still lies in a section.
_IN_PLANE_MM = 1e-6

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Simplex:
    """What is to be known of the cells of one dimension, with their facets.

    Attributes
    ----------
    dim
        2 triangles of a section, 3 tetrahedra.
    edges, facets
        Corners of the edges that carry mid-nodes, and of the facets.
    facet_edges
        Likewise of the edges of a facet.
    cell, facet
        Names of the quadratic shapes in meshio.
    gmsh_cell, gmsh_facet
        Their numbers in .msh files.
    vtk_order
        Where VTK's nodes stand among gmsh's.
    plural
        Of the cells, in English.
    """

    dim: int
    edges: Indices
    facets: Indices
    facet_edges: Indices
    cell: str
    facet: str
    gmsh_cell: int
    gmsh_facet: int
    vtk_order: list[int]
    plural: str

    @property
    def corners(self) -> int:
        """Number of a cell's corners."""
        return self.dim + 1

    def gradients(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradients (nodes, dim) of the quadratic shape functions at a point.

        Parameters
        ----------
        weights
            Barycentric coordinates of the point, (corners,).
        """
        linear = np.vstack([-np.ones(self.dim), np.eye(self.dim)])
        one, other = self.edges.T
        at_corners = (4 * weights - 1)[:, None] * linear
        at_middles = weights[one, None] * linear[other] + weights[other, None] * linear[one]
        return np.vstack([at_corners, 4 * at_middles])


SOLID = Simplex(
    3, TET_EDGES, TET_FACETS, TRIANGLE_EDGES, "tetra10", "triangle6", 11, 9, VTK_ORDER, "tetrahedra"
)
FLAT = Simplex(
    2,
    TRIANGLE_EDGES,
    TRIANGLE_EDGES,
    LINE_EDGES,
    "triangle6",
    "line3",
    9,
    8,
    [*range(6)],
    "triangles",
)


def simplex_of(cells: Indices) -> Simplex:
    """Return the shape of cells with (m, 4) or (m, 10) nodes, tetrahedra, or (m, 3) or (m, 6)."""
    return SOLID if cells.shape[1] in (4, 10) else FLAT


@dataclass(frozen=True)
class FingerMesh:
    """Quadratic cells of a finger with tags: tetrahedra, or triangles of a plane section.

    Parameters
    ----------
    nodes
        (n, 3) coordinates in mm.
    cells
        (m, 10) nodes of each tetrahedron, or (m, 6) of each triangle, in gmsh's order.
    tissue
        (m,) tags from `TISSUES`.
    facets
        (k, 6) or (k, 3) nodes of the tagged facets, in gmsh's order.
    surface
        (k,) tags from `SURFACES`. "skin" is the outer skin without nail and cut, "interface"
        lies between epidermis and dermis, "bone_surface" is that of the bone without the cut.
    """

    nodes: NDArray[np.float64]
    cells: Indices
    tissue: Indices
    facets: Indices
    surface: Indices

    @property
    def simplex(self) -> Simplex:
        """The shape of its cells."""
        return simplex_of(self.cells)

    @cached_property
    def plane(self) -> Plane:
        """The plane of a section; space, if it is none."""
        return SPACE if self.simplex is SOLID else Plane.through(self.nodes)

    def corners_of(self, surface: str) -> NDArray[np.float64]:
        """Return the corners of a surface's facets, (k, 3, 3) or (k, 2, 3) in mm."""
        return self.nodes[self.facets[self.surface == SURFACES[surface], : self.simplex.dim]]

    @property
    def missing(self) -> list[str]:
        """Names of the tissues and surfaces that it lacks, but for nail and, in a section, cut."""
        tags = {*np.unique(self.tissue).tolist(), *np.unique(self.surface).tolist()}
        optional = {"nail"} if self.simplex is SOLID else {"nail", "cut"}
        parts = {**TISSUES, **SURFACES}
        return [name for name, tag in parts.items() if tag not in tags and name not in optional]

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the content, in hexadecimal digits."""
        digest = hashlib.sha256(np.ascontiguousarray(self.nodes, dtype="<f8").tobytes())
        for array in (self.cells, self.tissue, self.facets, self.surface):
            digest.update(np.ascontiguousarray(array, dtype="<i8").tobytes())
        return digest.hexdigest()


def held_parts(
    mesh: FingerMesh, names: Sequence[str]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which cells (m,) and nodes (n,) belong to the named tissues and surfaces."""
    cells = np.isin(mesh.tissue, [tag for name, tag in TISSUES.items() if name in names])
    facets = np.isin(mesh.surface, [tag for name, tag in SURFACES.items() if name in names])
    nodes = np.zeros(len(mesh.nodes), dtype=bool)
    nodes[mesh.cells[cells]] = True
    nodes[mesh.facets[facets]] = True
    return cells, nodes


def facets_of(cells: Indices) -> tuple[Indices, Indices, Indices]:
    """Find the facets of tetrahedra or triangles, linear or quadratic.

    Returns
    -------
    facets, first, second
        (f, 3) or (f, 2) corners, oriented outwards from the cell `first` (f,); the cell `second`
        (f,) on the other side is -1 on the boundary.

    Raises
    ------
    ValueError
        A facet belongs to more than two cells.
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


def quadratic(
    nodes: NDArray[np.float64], cells: Indices, facets: Indices
) -> tuple[NDArray[np.float64], Indices, Indices]:
    """Add midpoints: linear cells and facets become straight quadratic ones.

    Returns
    -------
    nodes, cells, facets
        The corner nodes come first and keep their numbers. Coordinates are rounded to 1e-8 mm
        (midpoints 1e-9), which keeps files short.
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


def lowest_facet(
    x: float, y: float, facets: NDArray[np.float64]
) -> tuple[int, NDArray[np.float64]] | None:
    """Return the lowest facet over or under a point of the XY plane, and where it meets it.

    That is the facet's index in `facets`, (m, 3, 3) corners of triangles or (m, 2, 3) of lines in
    an upright plane, and barycentric coordinates (3,) or (2,) in it; None if there is no facet.
    """
    weights = _weights(np.array([x, y]), facets[..., :2])
    inside = np.flatnonzero(np.all(weights >= -_EDGE, axis=1))
    if not len(inside):
        return None
    height = np.einsum("mi,mi->m", weights[inside], facets[inside, :, 2])
    lowest = int(inside[np.argmin(height)])
    return lowest, weights[lowest]


def _weights(point: NDArray[np.float64], facets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a point's barycentric coordinates in facets of the plane, -1 where it has none."""
    corner, edges = facets[:, 0], facets[:, 1:] - facets[:, :1]
    p = point - corner
    if edges.shape[1] == 1:
        along = edges[:, 0]
        square = np.sum(along**2, axis=1)
        t = np.sum(p * along, axis=1) / np.where(square == 0, np.inf, square)
        aside = np.abs(p - t[:, None] * along).max(axis=1)
        found, sound = np.column_stack([1 - t, t]), (square > 0) & (aside < _IN_PLANE_MM)
    else:
        (a, b), (c, d) = edges[:, :, 0].T, edges[:, :, 1].T
        det = a * d - b * c
        safe = np.where(det == 0, np.inf, det)
        second = (d * p[:, 0] - b * p[:, 1]) / safe
        third = (a * p[:, 1] - c * p[:, 0]) / safe
        found, sound = np.column_stack([1 - second - third, second, third]), det != 0
    return np.where(sound[:, None], found, -1.0)
