"""What displacements of the nodes mean: deformed points of the skin, and strains of the tissues."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
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


def deformation_gradients(finger: FingerMesh, displacement_mm: Array, tissue: str) -> Array:
    """Return F (cells, d, d) at the centres of the cells of a tissue; d is 2 in a section.

    `displacement_mm` (n, d) is that of the nodes.
    """
    cells, shape = finger.cells[finger.tissue == TISSUES[tissue]], finger.simplex
    corners = finger.plane.within(finger.nodes)[cells[:, : shape.corners]]
    edges = corners[:, 1:] - corners[:, :1]
    slopes = shape.gradients(np.full(shape.corners, 1 / shape.corners))
    gradient = np.einsum("na,cni->cia", slopes, displacement_mm[cells])
    # The inverse of the edges is the gradient of the reference coordinates, transposed.
    return np.eye(shape.dim) + gradient @ np.swapaxes(np.linalg.inv(edges), 1, 2)


def principal_strains(finger: FingerMesh, displacement_mm: Array, tissue: str) -> Array:
    """Return the principal strains (cells, d), stretch less 1, in increasing order."""
    F = deformation_gradients(finger, displacement_mm, tissue)
    return np.linalg.svd(F, compute_uv=False)[:, ::-1] - 1


def centres(finger: FingerMesh, tissue: str) -> Array:
    """Return the centres (cells, 3) of the undeformed cells of a tissue, mm."""
    cells = finger.cells[finger.tissue == TISSUES[tissue], : finger.simplex.corners]
    return finger.nodes[cells].mean(axis=1)


def under_contact(finger: FingerMesh, tissue: str, half_mm: float) -> NDArray[np.bool_]:
    """Return which cells of a tissue lie within `half_mm` of the contact point, X and Y."""
    at = centres(finger, tissue)
    palmar = at[:, 2] < np.median(finger.nodes[:, 2])
    return palmar & np.all(np.abs(at[:, :2]) < half_mm, axis=1)
