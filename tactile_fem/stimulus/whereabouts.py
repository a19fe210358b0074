"""Whether a body touches the finger along its path, and where it is if it does not."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np

from tactile_fem.stimulus.body import Array, RigidBody
from tactile_fem.stimulus.height_field import height_map

# A body is searched for within a distance of the path and in steps, down to a height.
_SEARCHES_MM, _LOWEST_MM = ((100.0, 0.5), (1000.0, 5.0)), -3.0
# Steps along the path and on the skin, whose facets are divided so often at most.
_PATH_STEP_MM, _SKIN_STEP_MM, _MAX_PARTS = 0.5, 0.25, 20
_TOUCH_MM = 1e-3


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
    path = -places_mm[:, :2]
    for far, step in _SEARCHES_MM:
        ends = zip(path.min(axis=0) - far, path.max(axis=0) + far, strict=True)
        x, y = (np.arange(low, high + step, step) for low, high in ends)
        found = np.argwhere(height_map(body, x, y, _LOWEST_MM) > _LOWEST_MM)
        if len(found):
            break
    else:
        return f"it is more than {far:g} mm away, or deeper than {-_LOWEST_MM:g} mm"
    places = np.column_stack([x[found[:, 0]], y[found[:, 1]]])
    a, b = path, np.roll(path, -1, axis=0)
    b[-1] = a[-1]
    squares = np.maximum(np.sum((b - a) ** 2, axis=1), 1e-12)
    offset = np.full((len(places), 2), np.inf)
    for start, line, square in zip(a, b - a, squares, strict=True):
        share = np.clip((places - start) @ line / square, 0, 1)
        aside = places - start - share[:, None] * line
        closer = np.linalg.norm(aside, axis=1) < np.linalg.norm(offset, axis=1)
        offset[closer] = aside[closer]
    dx, dy = offset[np.argmin(np.linalg.norm(offset, axis=1))]
    return (
        f"its nearest place lies {np.hypot(dx, dy):.3g} mm from the contact point, "
        f"{dx:+.3g} mm across and {dy:+.3g} mm along the finger"
    )
