"""Whether a rigid body can be used and touches the finger, before any long computation."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import EXCESS_MM, NEAR_MM, Array, RigidBody
from tactile_fem.stimulus.sampled import height_map

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
# A body is searched for within a distance of the path and in steps, down to a height.
_SEARCHES_MM, _LOWEST_MM = ((100.0, 0.5), (1000.0, 5.0)), -3.0
# Steps along the path and on the skin, whose facets are divided so often at most.
_PATH_STEP_MM, _SKIN_STEP_MM, _MAX_PARTS = 0.5, 0.25, 20
_TOUCH_MM = 1e-3


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


def miss(body: RigidBody, places_mm: Array, skin_mm: Array) -> str | None:
    """Return in a sentence that a body does not touch a finger along its path; None if it does.

    Parameters
    ----------
    body
        The body.
    places_mm
        Knots of its path, (n, 3).
    skin_mm
        Corners of the undeformed skin's facets, (m, 3, 3) or, of a section, (m, 2, 3).
    """
    skin = skin_mm.reshape(-1, 3)
    deepest = float(places_mm[:, 2].max())
    near = _points(skin_mm[skin_mm[..., 2].min(axis=1) < deepest + _TOUCH_MM])
    if not len(near):
        return (
            f"the stimulator does not reach the finger on its way, whose deepest place is "
            f"{deepest:.3g} mm, {skin[:, 2].min() - deepest:.3g} mm below the skin"
        )
    if any(body.distance(near - place).gap.min() < _TOUCH_MM for place in _along(places_mm)):
        return None
    return f"the stimulator does not touch the finger on its way: {_where(body, places_mm)}"


def _points(facets: Array) -> Array:
    """Return points (n, 3) of facets (m, d, 3)."""
    d = facets.shape[1]
    edges = np.linalg.norm(facets - np.roll(facets, 1, axis=1), axis=2)
    parts = min(int(np.ceil(edges.max(initial=0) / _SKIN_STEP_MM)), _MAX_PARTS) or 1
    weights = [w for w in product(range(parts + 1), repeat=d) if sum(w) == parts]
    return np.einsum("wk,mkd->mwd", np.array(weights) / parts, facets).reshape(-1, 3)


def _along(knots: Array) -> Array:
    """Return places along a path: the deepest first, the knots, then those between them."""
    between = [np.zeros((0, 3))]
    for a, b in pairwise(knots):
        parts = int(np.ceil(np.linalg.norm(b - a) / _PATH_STEP_MM))
        between.append(a + np.linspace(0, 1, max(parts, 1), endpoint=False)[1:, None] * (b - a))
    knots = np.unique(knots, axis=0)
    return np.vstack([knots[np.argsort(-knots[:, 2])], *between])


def _where(body: RigidBody, places_mm: Array) -> str:
    """Return where the nearest place of a body is, seen from above, in its own axes."""
    import shapely  # takes a while

    path = -places_mm[:, :2]
    for far, step in _SEARCHES_MM:
        ends = zip(path.min(axis=0) - far, path.max(axis=0) + far, strict=True)
        x, y = (np.arange(low, high + step, step) for low, high in ends)
        found = np.argwhere(height_map(body, x, y, _LOWEST_MM) > _LOWEST_MM)
        if len(found):
            break
    else:
        return f"it is more than {far:g} mm away, or deeper than {-_LOWEST_MM:g} mm"
    line = shapely.linestrings(np.vstack([path, path[-1:]]))
    ways = shapely.shortest_line(line, shapely.points(x[found[:, 0]], y[found[:, 1]]))
    start, end = shapely.get_coordinates(ways[np.argmin(shapely.length(ways))])
    dx, dy = end - start
    return (
        f"its nearest place lies {np.hypot(dx, dy):.3g} mm from the contact point, "
        f"{dx:+.3g} mm across and {dy:+.3g} mm along the finger"
    )
