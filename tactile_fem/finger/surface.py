"""Points on the skin of the pad, undeformed and deformed."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import SURFACES, FingerMesh, Indices, lowest_facet

Array = NDArray[np.float64]


class SkinSurface:
    """Points on the undeformed skin of the pad, and the interpolation of nodal vectors to them.

    Parameters
    ----------
    finger
        The mesh.
    xy_mm
        (k, 2) places X, Y of the points.

    Attributes
    ----------
    rest_mm
        (k, 3) undeformed points.

    Raises
    ------
    StudyError
        There is no skin at a place.
    """

    def __init__(self, finger: FingerMesh, xy_mm: ArrayLike) -> None:
        skin = finger.facets[finger.surface == SURFACES["skin"]]
        facets = finger.corners_of("skin")
        found = []
        for x, y in np.asarray(xy_mm, float):
            below = lowest_facet(x, y, facets)
            if below is None:
                raise StudyError(f"there is no skin at X {x:.2f}, Y {y:.2f} mm")
            found.append(below)
        self._nodes = skin[[facet for facet, _ in found]]
        weights = np.array([weights for _, weights in found])
        self._basis = _quadratic_basis(weights, finger.simplex.facet_edges)
        self.rest_mm = self.at(finger.nodes)

    def at(self, nodal: ArrayLike) -> Array:
        """Return the points' values (k, c) of nodal values (n, c) in the mesh file's order."""
        return np.einsum("kn,knc->kc", self._basis, np.asarray(nodal)[self._nodes])

    def deformed_mm(self, displacement_mm: ArrayLike) -> Array:
        """Return the deformed points (k, 3) for nodal displacements (n, 3)."""
        return self.rest_mm + self.at(displacement_mm)


def _quadratic_basis(weights: Array, edges: Indices) -> Array:
    """Return a facet's P2 functions (k, nodes), gmsh's order, at barycentric coordinates (k, d)."""
    first, second = edges.T
    return np.hstack([weights * (2 * weights - 1), 4 * weights[:, first] * weights[:, second]])
