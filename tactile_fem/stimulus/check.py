"""Whether a rigid body can be used and touches the finger, before any long computation."""

from __future__ import annotations

from itertools import product

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.path.rotations import ARM_MM, angle_rad, between, to_body
from tactile_fem.stimulus.body import EXCESS_MM, NEAR_MM, Array, RigidBody
from tactile_fem.stimulus.sampled import height_map, heights_at

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
# Steps along the path, whose knots are thinned to others, and on the skin, whose facets are divided
# so often at most.
_PATH_STEP_MM, _KNOT_STEP_MM, _SKIN_STEP_MM, _MAX_PARTS = 0.5, 0.1, 0.25, 20
_TOUCH_MM = 1e-3
# Where a surface is steeper than this slope, its edges can make the skin's contact change abruptly.
_STEEP = 0.5
# Edges with at least this radius of curvature, and the one for facets of 1 mm times the root of the
# skin's, are harmless, and so are walls that rise by less within a window (less by the square of
# facets below 1 mm).
# Measured as failed steps of scans of a plus, 0.5 mm high if not stated, low_pass_mm 0.05 to 1.
# Facets of 0.25 mm (a section): none at a radius of 0.061 mm, 10 at 0.058 mm. Facets of 1 mm: none
# at 0.12 mm, 4 at 0.085 mm, 6 at 0.017 mm and 0.2 mm high, none at 0.023 mm and 0.1 mm high. Facets
# of 3 mm: none at 0.34 mm, 12 at 0.12 mm.
_LEAST_RADIUS_MM, _RADIUS_AT_1_MM = 0.06, 0.1
_LEAST_RISE_MM, _WINDOW_MM = 0.12, 1.0
# Of a surface, over which edges are sought (a tenth of a second), and its width in a section.
_SAMPLES, _STRIP_MM = 20_000, 0.01
# Facets blur waves shorter than two of them. They may blur this share of the relief (rms): of
# letters, dots, Braille and a grating of 2 mm, facets of 1 mm blur 0.38 to 0.53, those of 3 mm 0.79
# to 0.93. A relief below so many mm is smooth. It is sampled at a fifth of the facets.
_MOST_BLURRED, _SMOOTH_MM, _SAMPLING_MM = 0.6, 0.01, (0.05, 0.2)
# Standard deviation of a Gaussian that halves a wave, to its length (ISO 16610-61).
_GAUSSIAN = np.sqrt(np.log(2) / 2) / np.pi


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


def miss(
    body: RigidBody, places_mm: Array, skin_mm: Array, turns_rad: Array | None = None
) -> str | None:
    """Return in a sentence that a body does not touch a finger along its path; None if it does.

    Parameters
    ----------
    body
        The body.
    places_mm
        Knots of its path, (n, 3).
    skin_mm
        Corners of the undeformed skin's facets, (m, 3, 3) or, of a section, (m, 2, 3).
    turns_rad
        Rotation vectors of the body at the knots, (n, 3); None if it does not turn.
    """
    turns = np.zeros_like(places_mm) if turns_rad is None else turns_rad
    lowest = np.inf
    for place, turn in zip(*_along(places_mm, turns), strict=True):
        # A body lies below Z = 0 of its own frame.
        heights = to_body(skin_mm, place, turn)[..., 2].min(axis=1)
        lowest = min(lowest, float(heights.min()))
        near = to_body(_points(skin_mm[heights < _TOUCH_MM]), place, turn)
        if len(near) and body.distance(near).gap.min() < _TOUCH_MM:
            return None
    if lowest >= _TOUCH_MM:
        return (
            "the stimulator does not reach the finger on its way, whose deepest place is "
            f"{places_mm[:, 2].max():.3g} mm, {lowest:.3g} mm below the skin"
        )
    path = to_body(np.zeros((1, 3)), places_mm, turns_rad)[:, 0, :2]
    return f"the stimulator does not touch the finger on its way: {_where(body, path)}"


def _points(facets: Array) -> Array:
    """Return points (n, 3) of facets (m, d, 3)."""
    d = facets.shape[1]
    edges = np.linalg.norm(facets - np.roll(facets, 1, axis=1), axis=2)
    parts = min(int(np.ceil(edges.max(initial=0) / _SKIN_STEP_MM)), _MAX_PARTS) or 1
    weights = [w for w in product(range(parts + 1), repeat=d) if sum(w) == parts]
    return np.einsum("wk,mkd->mwd", np.array(weights) / parts, facets).reshape(-1, 3)


def _along(places: Array, turns: Array) -> tuple[Array, Array]:
    """Return places and turns along a path, the deepest first, from its knots (n, 3)."""
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
    moved += ARM_MM * angle_rad(turns[:-1], turns[1:])
    length = np.append(0.0, np.cumsum(moved))
    knots = length[np.unique(np.ceil(length / _KNOT_STEP_MM), return_index=True)[1]]
    at = np.union1d(knots, [*np.arange(0.0, length[-1], _PATH_STEP_MM), length[-1]])
    along = np.column_stack([np.interp(at, length, column) for column in places.T])
    deepest_first = np.argsort(-along[:, 2], kind="stable")
    return along[deepest_first], between(turns, length, at)[deepest_first]


def _where(body: RigidBody, path: Array) -> str:
    """Return where the nearest place of a body is from a path over it, (n, 2) in its own axes."""
    import shapely  # takes a while

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


def too_sharp(body: RigidBody, low: Array, high: Array, facet_mm: float) -> str | None:
    """Return in a sentence that a body is too sharp for the skin's facets; None if it is not.

    Parameters
    ----------
    body
        The body.
    low, high
        Corners (2,) of the part of it, in X and Y, that the skin may touch.
    facet_mm
        Length of the facets.
    """
    from scipy import ndimage  # takes a while

    extent = np.maximum(high - low, _STRIP_MM)
    counts = np.ceil(extent / np.sqrt(np.prod(extent) / _SAMPLES))
    nx, ny = counts.astype(int).tolist()
    # Not in rows, between which edges along them could lie.
    cells = np.random.default_rng(0).random((nx, ny, 2)) + np.moveaxis(np.indices((nx, ny)), 0, -1)
    xy = (low + extent * cells / counts).reshape(-1, 2)
    z = heights_at(body, xy)
    window = np.ceil(_WINDOW_MM * counts / extent).astype(int)
    filters = ndimage.maximum_filter, ndimage.minimum_filter
    high_z, low_z = (each(z.reshape(nx, ny), window, mode="nearest").ravel() for each in filters)
    found = body.distance(np.column_stack([xy, z]))
    size = np.linalg.norm(found.normal, axis=1)
    is_steep = found.normal[:, 2] < size * np.cos(np.arctan(_STEEP))
    is_steep &= np.abs(found.gap) < _TOUCH_MM  # not beside the body
    steep = np.flatnonzero(is_steep & (high_z - low_z > _LEAST_RISE_MM * min(facet_mm, 1.0) ** 2))
    if not len(steep):
        return None
    normal = found.normal[steep] / size[steep, None]
    along = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    curvature = np.linalg.eigvalsh(along @ found.hessian[steep] @ along)[:, -1] / size[steep]
    worst = int(np.argmax(curvature))
    least_mm = max(_LEAST_RADIUS_MM, _RADIUS_AT_1_MM * np.sqrt(facet_mm))
    if curvature[worst] * least_mm <= 1:
        return None
    (x, y), radius_mm = xy[steep[worst]], 1 / curvature[worst]
    return (
        f"the surface is steep at X {x:.2f}, Y {y:.2f} mm (at displacement 0), beside an edge with "
        f"a radius of {radius_mm:.2g} mm, while the skin's facets of {facet_mm:.2g} mm need "
        f"{least_mm:.2g} mm; the scan may take long or diverge: choose a finer mesh or a smoother "
        "surface"
    )


def too_fine(body: RigidBody, low: Array, high: Array, facet_mm: float) -> str | None:
    """Return in a sentence that a body is too fine for the skin's facets; see `too_sharp`."""
    from scipy import ndimage  # takes a while

    step = float(np.clip(facet_mm / 5, *_SAMPLING_MM))
    x, y = (np.arange(a, b + step, step) for a, b in np.transpose([low, high]))
    z = height_map(body, x, y)

    def blurred(length_mm: float) -> float:
        smooth = ndimage.gaussian_filter(z, 2 * length_mm * _GAUSSIAN / step, mode="nearest")
        return float(np.std(z - smooth) / max(np.std(z), _SMOOTH_MM))

    if (share := blurred(facet_mm)) < _MOST_BLURRED:
        return None
    finer = next(b for k in range(1, 99) if blurred(b := facet_mm * 0.9**k) < _MOST_BLURRED)
    return (
        f"the skin's facets of {facet_mm:.2g} mm cannot follow it: waves shorter than "
        f"{2 * facet_mm:.2g} mm make up {100 * share:.0f} % of its relief (rms); what is felt will "
        f"be wrong: choose a finer mesh, with facets of at most {finer:.2g} mm"
    )
