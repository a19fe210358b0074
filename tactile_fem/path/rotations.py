"""Rotations of the body, as rotation vectors: axis times angle in rad."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
# A turn counts as a way, and a torque as a force, at this distance from the axis.
ARM_MM = 5.0


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


def angle_rad(before_rad: ArrayLike, after_rad: ArrayLike) -> Array:
    """Return the angles (...) between rotations, given as rotation vectors (..., 3)."""
    turn = matrix(after_rad) @ matrix(before_rad).swapaxes(-1, -2)
    cosine = (np.trace(turn, axis1=-2, axis2=-1) - 1) / 2
    skew = turn - turn.swapaxes(-1, -2)
    found: Array = np.arctan2(np.linalg.norm(skew, axis=(-2, -1)) / np.sqrt(8), cosine)
    return found


def turned(start_rad: Array, turn_rad: Array) -> Array:
    """Return the rotation vector of the rotation `start_rad` followed by `turn_rad`, (3,)."""
    if not np.any(turn_rad):
        return start_rad
    return vector(matrix(turn_rad) @ matrix(start_rad))


def since_first(turns_rad: Array) -> Array:
    """Return rotation vectors (n, 3) since the first of those given, (n, 3).

    Of those that are the same rotation it is the nearest to the one before, also beyond pi.
    """
    rotations = matrix(turns_rad)
    found = np.zeros_like(turns_rad)
    for k, rotation in enumerate(rotations[1:], 1):
        turn = vector(rotation @ rotations[0].T)
        angle = float(np.linalg.norm(turn))
        axis = turn / angle if angle else turn
        rounds = np.round((found[k - 1] @ axis - angle) / (2 * np.pi))
        found[k] = turn + 2 * np.pi * rounds * axis
    return found


def between(turns_rad: Array, times: Array, at: ArrayLike) -> Array:
    """Return rotation vectors (n, 3) at some times (n,), on the shortest way between those given.

    Given are vectors (k, 3) at times (k,) that do not decrease; before and after them it is the
    first and the last one.
    """
    at = np.asarray(at, dtype=float)
    if not turns_rad.any():
        return np.zeros((*at.shape, 3))
    from scipy.spatial.transform import Slerp  # takes a while

    times, first = np.unique(times, return_index=True)
    if len(times) == 1:
        return np.broadcast_to(turns_rad[first[0]], (*at.shape, 3))
    course = Slerp(times, _rotation().from_rotvec(turns_rad[first]))
    found: Array = course(np.clip(at, times[0], times[-1])).as_rotvec()
    return found


def to_space(points_mm: Array, place_mm: ArrayLike, turn_rad: ArrayLike | None = None) -> Array:
    """Return where points (..., n, 3) of the body's frame are in space.

    Its origin is at `place_mm` (..., 3), its rotation vector there `turn_rad` (..., 3); None if it
    does not turn.
    """
    if turn_rad is not None:
        points_mm = points_mm @ matrix(turn_rad).swapaxes(-1, -2)
    return points_mm + np.asarray(place_mm)[..., None, :]


def to_body(points_mm: Array, place_mm: ArrayLike, turn_rad: ArrayLike | None = None) -> Array:
    """Return where points (..., n, 3) of space are in the body's frame, as in `to_space`."""
    found: Array = points_mm - np.asarray(place_mm)[..., None, :]
    return found if turn_rad is None else found @ matrix(turn_rad)


def swept(
    low_mm: Iterable[float],
    high_mm: Iterable[float],
    places_mm: Array,
    turns_rad: Array | None = None,
) -> tuple[Array, Array]:
    """Return the lowest and the highest coordinates of a box of space in the body's frame, (3,).

    The box reaches from `low_mm` to `high_mm`, (3,); the body goes to places and turns (n, 3).
    """
    corners = np.array(list(product(*zip(low_mm, high_mm, strict=True))), dtype=np.float64)
    seen = to_body(corners, places_mm, turns_rad)
    return seen.min(axis=(0, 1)), seen.max(axis=(0, 1))


def _rotation() -> Any:
    from scipy.spatial.transform import Rotation  # takes a while

    return Rotation


def moment_about(point_mm: Array, force_N: Array, moment_Nmm: Array) -> Array:
    """Return moments about points (..., 3) from those about the origin and their forces."""
    return moment_Nmm - np.cross(point_mm, force_N)
