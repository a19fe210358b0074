"""Tries rigid bodies before any long work."""

from __future__ import annotations

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import EXCESS_MM, NEAR_MM, Array, RigidBody

# Points above and beside a body, in its own frame, (n, 3) mm.
POINTS = np.stack(
    np.meshgrid(np.linspace(-6, 6, 25), np.linspace(-12, 12, 49), np.linspace(-0.5, 2.5, 4)), -1
).reshape(-1, 3)
# Corners of the box in which a distance is compared with ways of these lengths.
_NEAR_MM = np.array([[-6.0, -12.0, -1.0], [6.0, 12.0, 1.0]])
_WAYS_MM = (0.1, 0.4)
# A gradient shorter than this has no direction; a distance steeper than this is none.
_SHORTEST, _STEEPEST = 1e-6, 1.02


def check_body(body: RigidBody, name: str) -> None:
    """Raise StudyError if a body's distance, gradient or Hessian cannot be used near the finger.

    Parameters
    ----------
    body
        Of the study, or a user's own.
    name
        Of the input that states it, for the message.
    """
    found = body.distance(POINTS)
    shapes = [np.shape(found.gap), np.shape(found.normal), np.shape(found.hessian)]
    count = len(POINTS)
    if shapes != [(count,), (count, 3), (count, 3, 3)]:
        raise StudyError(
            f"{name}: distance(points) of (n, 3) points must give a gap (n,), a normal "
            f"(n, 3) and a Hessian (n, 3, 3), but gives {shapes} for n = {count}."
        )
    if not all(np.isfinite(part).all() for part in (found.gap, found.normal, found.hessian)):
        raise StudyError(f"{name}: its distance, normal or Hessian is not finite near it.")
    pointless = (np.linalg.norm(found.normal, axis=1) < _SHORTEST) & (found.gap > 0)
    if pointless.any():
        raise StudyError(
            f"{name}: its normal is zero at {_shown(POINTS[pointless][0])} outside of it; it must "
            "be the gradient of the distance."
        )


def check_lipschitz(body: RigidBody, name: str) -> None:
    """Raise StudyError if a distance changes by more than the way between two points.

    See `RigidBody`: contact would be overlooked.
    """
    rng = np.random.default_rng(0)
    points = rng.uniform(*_NEAR_MM, size=(len(POINTS), 3))
    gap, ways = body.distance(points).gap, rng.normal(size=points.shape)
    near = (gap > 0) & (gap < NEAR_MM)
    for way_mm in _WAYS_MM:
        ways *= way_mm / np.linalg.norm(ways, axis=1)[:, None]
        change = np.where(near, np.abs(body.distance(points + ways).gap - gap), 0.0)
        worst = int(np.argmax(change))
        if change[worst] > _STEEPEST * way_mm + EXCESS_MM:
            raise StudyError(
                f"{name}: its distance changes by {change[worst]:.3g} mm over a way of {way_mm:g} "
                f"mm at {_shown(points[worst])}, but must not change by more than the way: divide "
                "it by its steepest slope."
            )


def _shown(place: Array) -> str:
    x, y, z = place
    return f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm of its own frame"
