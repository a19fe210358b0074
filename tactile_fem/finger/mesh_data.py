"""The mesh of a finger as plain arrays, and the tags of its parts."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

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
# Corners of the edges that carry nodes 5 to 10 (tetra10) and 4 to 6 (triangle6), gmsh's order.
TET_EDGES = np.array([[0, 1], [1, 2], [2, 0], [3, 0], [2, 3], [1, 3]])
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
# In VTK, meshio, CalculiX and Abaqus the last two mid-nodes of a tetrahedron are swapped.
VTK_ORDER = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
# Tolerance in barycentric coordinates for a point inside a facet.
_EDGE = 1e-9


@dataclass(frozen=True)
class FingerMesh:
    """Ten-node tetrahedra of a finger with tags.

    Parameters
    ----------
    nodes
        (n, 3) coordinates in mm.
    tets
        (m, 10) nodes of each tetrahedron, in gmsh's order.
    tissue
        (m,) tags from `TISSUES`.
    triangles
        (k, 6) nodes of the tagged facets, in gmsh's order.
    surface
        (k,) tags from `SURFACES`. "skin" is the outer skin without nail and cut, "interface"
        lies between epidermis and dermis, "bone_surface" is that of the bone without the cut.
    """

    nodes: NDArray[np.float64]
    tets: NDArray[np.int64]
    tissue: NDArray[np.int64]
    triangles: NDArray[np.int64]
    surface: NDArray[np.int64]

    @property
    def missing(self) -> list[str]:
        """Names of the tissues and surfaces that it lacks, but for the nail."""
        tags = {*np.unique(self.tissue).tolist(), *np.unique(self.surface).tolist()}
        parts = {**TISSUES, **SURFACES}
        return [name for name, tag in parts.items() if tag not in tags and name != "nail"]

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the content, in hexadecimal digits."""
        digest = hashlib.sha256(np.ascontiguousarray(self.nodes, dtype="<f8").tobytes())
        for array in (self.tets, self.tissue, self.triangles, self.surface):
            digest.update(np.ascontiguousarray(array, dtype="<i8").tobytes())
        return digest.hexdigest()


def held_parts(
    mesh: FingerMesh, names: Sequence[str]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which tetrahedra (m,) and nodes (n,) belong to the named tissues and surfaces."""
    tets = np.isin(mesh.tissue, [tag for name, tag in TISSUES.items() if name in names])
    facets = np.isin(mesh.surface, [tag for name, tag in SURFACES.items() if name in names])
    nodes = np.zeros(len(mesh.nodes), dtype=bool)
    nodes[mesh.tets[tets]] = True
    nodes[mesh.triangles[facets]] = True
    return tets, nodes


def facets_of(tets: NDArray[np.int64]) -> tuple[NDArray, NDArray, NDArray]:
    """Find the facets of tetrahedra with (m, 4) or (m, 10) nodes.

    Returns
    -------
    facets, first, second
        (f, 3) corners, oriented outwards from the cell `first` (f,); the cell `second` (f,) on
        the other side is -1 on the boundary.

    Raises
    ------
    ValueError
        A facet belongs to more than two cells.
    """
    corners = tets[:, TET_FACETS].reshape(-1, 3)
    _, start, group, count = np.unique(
        np.sort(corners, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    if count.max() > 2:
        raise ValueError("a facet belongs to more than two tetrahedra")
    total = np.zeros(len(start), dtype=np.int64)
    owner = np.repeat(np.arange(len(tets)), 4)
    np.add.at(total, group.reshape(-1), owner)
    first = owner[start]
    second = np.where(count == 2, total - first, -1)
    return corners[start], first, second


def quadratic(
    nodes: NDArray[np.float64], tets: NDArray[np.int64], triangles: NDArray[np.int64]
) -> tuple[NDArray, NDArray, NDArray]:
    """Add midpoints: four- and three-node elements become straight ten- and six-node ones.

    Returns
    -------
    nodes, tets, triangles
        The corner nodes come first and keep their numbers. Coordinates are rounded to 1e-8 mm
        (midpoints 1e-9), which keeps files short.
    """
    nodes = np.round(nodes, 8)
    edges = np.sort(tets[:, TET_EDGES].reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    middle = number.reshape(-1, 6) + len(nodes)
    key = unique[:, 0] * len(nodes) + unique[:, 1]
    sides = np.sort(triangles[:, TRIANGLE_EDGES], axis=2)
    sides = np.searchsorted(key, sides[..., 0] * len(nodes) + sides[..., 1]) + len(nodes)
    return (
        np.vstack([nodes, np.round(nodes[unique].mean(axis=1), 9)]),
        np.hstack([tets, middle]),
        np.hstack([triangles, sides]),
    )


def lowest_facet(
    x: float, y: float, facets: NDArray[np.float64]
) -> tuple[int, NDArray[np.float64]] | None:
    """Return the lowest facet over or under a point of the XY plane, and where it meets it.

    That is the facet's index in `facets`, (m, 3, 3) corners, and barycentric coordinates (3,) in
    it; None if there is no facet.
    """
    corner, edges = facets[:, 0, :2], facets[:, 1:, :2] - facets[:, :1, :2]
    (a, b), (c, d) = edges[:, :, 0].T, edges[:, :, 1].T
    det = a * d - b * c
    safe = np.where(det == 0, np.inf, det)
    px, py = (np.array([x, y]) - corner).T
    second, third = (d * px - b * py) / safe, (a * py - c * px) / safe
    weights = np.column_stack([1 - second - third, second, third])
    inside = np.flatnonzero((det != 0) & np.all(weights >= -_EDGE, axis=1))
    if not len(inside):
        return None
    height = np.einsum("mi,mi->m", weights[inside], facets[inside, :, 2])
    lowest = int(inside[np.argmin(height)])
    return lowest, weights[lowest]
