"""Strain of a tissue at the centres of its cells, from the displacement of the nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import TISSUES, FingerMesh

Array = NDArray[np.float64]


def deformation_gradients(finger: FingerMesh, displacement_mm: Array, tissue: str) -> Array:
    """Return F (cells, d, d) at the centres of a tissue's cells; d is 2 in a section.

    Parameters
    ----------
    finger
        The mesh.
    displacement_mm
        Of its nodes, (n, d).
    tissue
        Its name.
    """
    cells, shape = finger.cells[finger.tissue == TISSUES[tissue]], finger.simplex
    corners = finger.plane.within(finger.nodes)[cells[:, : shape.corners]]
    edges = corners[:, 1:] - corners[:, :1]
    slopes = shape.gradients(np.full(shape.corners, 1 / shape.corners))
    gradient = np.einsum("na,cni->cia", slopes, displacement_mm[cells])
    # The inverse of the edges is the gradient of the reference coordinates, transposed.
    return np.eye(shape.dim) + gradient @ np.swapaxes(np.linalg.inv(edges), 1, 2)


def principal_strains(finger: FingerMesh, displacement_mm: Array, tissue: str) -> Array:
    """Return the principal strains (cells, d), stretch less 1, in increasing order.

    Parameters are those of `deformation_gradients`.
    """
    F = deformation_gradients(finger, displacement_mm, tissue)
    return np.linalg.svd(F, compute_uv=False)[:, ::-1] - 1


def centres(finger: FingerMesh, tissue: str) -> Array:
    """Return the centres (cells, 3) of a tissue's undeformed cells, mm."""
    cells = finger.cells[finger.tissue == TISSUES[tissue], : finger.simplex.corners]
    return finger.nodes[cells].mean(axis=1)


def under_contact(finger: FingerMesh, tissue: str, half_mm: float) -> NDArray[np.bool_]:
    """Return which of a tissue's cells lie within `half_mm` of the contact point, X and Y."""
    at = centres(finger, tissue)
    palmar = at[:, 2] < np.median(finger.nodes[:, 2])
    return palmar & np.all(np.abs(at[:, :2]) < half_mm, axis=1)
