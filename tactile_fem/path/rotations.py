"""Rotations of the body, as rotation vectors: axis times angle in rad."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def matrix(vectors_rad: ArrayLike) -> Array:
    """Return the rotations (..., 3, 3) of rotation vectors (..., 3)."""
    vectors = np.asarray(vectors_rad, dtype=float)
    found = np.broadcast_to(np.eye(3), (*vectors.shape, 3)).copy()
    turns = vectors.any(axis=-1)
    if turns.any():
        found[turns] = _rotation().from_rotvec(vectors[turns]).as_matrix()
    return found


def vector(rotation: Array) -> Array:
    """Return the rotation vector (3,) of a rotation (3, 3), its angle at most pi."""
    if np.array_equal(rotation, np.eye(3)):
        return np.zeros(3)
    found: Array = _rotation().from_matrix(rotation).as_rotvec()
    return found


def turned(start_rad: Array, turn_rad: Array) -> Array:
    """Return the rotation vector of the rotation `start_rad` followed by `turn_rad`, (3,)."""
    if not np.any(turn_rad):
        return start_rad
    return vector(matrix(turn_rad) @ matrix(start_rad))


def _rotation() -> Any:
    from scipy.spatial.transform import Rotation  # takes a while

    return Rotation
