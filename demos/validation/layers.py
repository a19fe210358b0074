"""Strain of the skin's layers under an indenter; used by `predictions.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import TET_EDGES, TISSUES, FingerMesh

Array = NDArray[np.float64]


def principal_strains(finger: FingerMesh, displacement_mm: Array, tissue: str) -> Array:
    """Return the principal strains (cells, 3), stretch less 1, at the centres of a tissue's cells.

    Parameters
    ----------
    finger
        The mesh.
    displacement_mm
        Of its nodes, (n, 3).
    tissue
        Its name.
    """
    cells = finger.cells[finger.tissue == TISSUES[tissue]]
    corners = finger.nodes[cells[:, :4]]
    edges = corners[:, 1:] - corners[:, :1]
    inverse = np.linalg.inv(edges)  # gradient of the reference coordinates, transposed
    gradient = np.einsum("na,cni->cia", _centre_gradients(), displacement_mm[cells])
    F = np.eye(3) + gradient @ np.swapaxes(inverse, 1, 2)
    return np.linalg.svd(F, compute_uv=False)[:, ::-1] - 1


def under_contact(finger: FingerMesh, tissue: str, half_mm: float) -> NDArray[np.bool_]:
    """Return which of a tissue's cells lie within `half_mm` of the contact point, X and Y."""
    cells = finger.cells[finger.tissue == TISSUES[tissue], :4]
    centres = finger.nodes[cells].mean(axis=1)
    palmar = centres[:, 2] < np.median(finger.nodes[:, 2])
    return palmar & np.all(np.abs(centres[:, :2]) < half_mm, axis=1)


def _centre_gradients() -> Array:
    """Return the gradients (10, 3) of the P2 functions at the centre of the tetrahedron."""
    weights = np.full(4, 0.25)
    linear = np.vstack([-np.ones(3), np.eye(3)])
    first, second = TET_EDGES.T
    corners = linear * (4 * weights[:, None] - 1)
    middles = 4 * (weights[first, None] * linear[second] + weights[second, None] * linear[first])
    return np.vstack([corners, middles])
