"""Checks of rigid bodies before any long computation."""

from __future__ import annotations

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import EXCESS_MM, NEAR_MM, Array, RigidBody

# Points above and beside a body, in its own frame, (n, 3) mm.
POINTS = np.stack(
    np.meshgrid(np.linspace(-6, 6, 25), np.linspace(-12, 12, 49), np.linspace(-0.5, 2.5, 4)), -1
).reshape(-1, 3)
# Corners of the box in which the distance is compared over steps of these lengths.
_BOX_MM = np.array([[-6.0, -12.0, -1.0], [6.0, 12.0, 1.0]])
_STEPS_MM = (0.1, 0.4)
_MAX_SLOPE = 1.02
# A shorter gradient has no direction.
_MIN_NORMAL = 1e-6


def check_body(body: RigidBody, name: str) -> None:
    """Raise StudyError if a body's distance, gradient or Hessian cannot be used near the finger.

    The message begins with `name`, that of the input.
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
    no_direction = (np.linalg.norm(found.normal, axis=1) < _MIN_NORMAL) & (found.gap > 0)
    if no_direction.any():
        raise StudyError(
            f"{name}: its normal is zero at {_shown(POINTS[no_direction][0])} outside of it; it "
            "must be the gradient of the distance."
        )


def check_lipschitz(body: RigidBody, name: str) -> None:
    """Raise StudyError if a distance changes by more than the step between two points.

    Contact would be overlooked, see `RigidBody`.
    """
    rng = np.random.default_rng(0)
    points = rng.uniform(*_BOX_MM, size=(len(POINTS), 3))
    gap, steps = body.distance(points).gap, rng.normal(size=points.shape)
    near = (gap > 0) & (gap < NEAR_MM)
    for step_mm in _STEPS_MM:
        steps *= step_mm / np.linalg.norm(steps, axis=1)[:, None]
        change = np.where(near, np.abs(body.distance(points + steps).gap - gap), 0.0)
        worst = int(np.argmax(change))
        if change[worst] > _MAX_SLOPE * step_mm + EXCESS_MM:
            raise StudyError(
                f"{name}: its distance changes by {change[worst]:.3g} mm over {step_mm:g} mm at "
                f"{_shown(points[worst])}, but must not change by more than that: divide it by its "
                "steepest slope."
            )


def _shown(place: Array) -> str:
    x, y, z = place
    return f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm of its own frame"
