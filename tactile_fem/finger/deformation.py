"""What displacements of the nodes mean: deformed points of the skin."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import SURFACES, FingerMesh
from tactile_fem.finger.plane import Array
from tactile_fem.finger.simplex import lowest_facet


class SkinSurface:
    """Points on the undeformed skin of the pad, and the interpolation of nodal vectors to them.

    Parameters
    ----------
    xy_mm
        (k, 2) places X, Y of the points; StudyError is raised if there is no skin.

    Attributes
    ----------
    rest_mm
        (k, 3) undeformed points.
    """

    def __init__(self, finger: FingerMesh, xy_mm: ArrayLike) -> None:
        facets = finger.facets[finger.surface == SURFACES["skin"]]
        corners = finger.corners_of("skin")
        nodes, weights = [], []
        for x, y in np.asarray(xy_mm, float):
            found = lowest_facet(x, y, corners)
            if found is None:
                raise StudyError(f"there is no skin at X {x:.2f}, Y {y:.2f} mm")
            nodes.append(facets[found[0]])
            weights.append(found[1])
        self._nodes, at = np.array(nodes), np.array(weights)
        one, other = finger.simplex.facet_edges.T
        # The quadratic functions of the corners, then of the mid-nodes.
        self._basis = np.hstack([at * (2 * at - 1), 4 * at[:, one] * at[:, other]])
        self.rest_mm = self.at(finger.nodes)

    def at(self, nodal: ArrayLike) -> Array:
        """Return values (k, c) at the points from nodal values (n, c), in the order of the file."""
        return np.einsum("kn,knc->kc", self._basis, np.asarray(nodal)[self._nodes])

    def deformed_mm(self, displacement_mm: ArrayLike) -> Array:
        """Return the deformed points (k, 3) for nodal displacements (n, 3)."""
        return self.rest_mm + self.at(displacement_mm)
