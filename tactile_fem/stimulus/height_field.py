"""The part of a rigid body that can touch the finger, as a facetted surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_fem.stimulus.body import Array, RigidBody

# Skin and body that stay this far apart, by undeformed shapes, do not touch.
_MARGIN_MM = 0.5
# Where the search for the surface along a vertical line begins and ends.
_TOP_MM, _LOWEST_MM, _TOLERANCE_MM = 0.1, -3.0, 1e-4
_MAX_ITERATIONS = 100


@dataclass(frozen=True)
class HeightField:
    """A body's upper side as squares, the body being where it touches the undeformed pad.

    `points` are (n, 3) in mm; `cells` (m, 4) points, counter-clockwise seen from above.
    """

    points: Array
    cells: NDArray[np.int64]


def height_field(
    body: RigidBody, places_mm: Array, skin: Array, grid_mm: tuple[float, float]
) -> HeightField:
    """Sample the part of the upper surface that can touch the finger along the path.

    Parameters
    ----------
    body
        The body.
    places_mm
        Its places along the path, (n, 3).
    skin
        (..., 3) undeformed points of the skin in mm.
    grid_mm
        Largest spacing in X and Y.
    """
    points = skin.reshape(-1, 3)
    deepest = places_mm[:, 2].max()
    near = points[points[:, 2] < deepest + _MARGIN_MM, :2]
    low = near.min(axis=0) - places_mm[:, :2].max(axis=0) - _MARGIN_MM
    high = near.max(axis=0) - places_mm[:, :2].min(axis=0) + _MARGIN_MM
    counts = np.ceil((high - low) / grid_mm).astype(int) + 1
    x, y = (np.linspace(*ends) for ends in zip(low, high, counts, strict=True))
    lowest = -deepest - _MARGIN_MM
    z = height_map(body, x, y, lowest)
    xyz = np.stack([*np.meshgrid(x, y, indexing="ij"), z], -1).reshape(-1, 3)
    index = np.arange(len(xyz)).reshape(z.shape)
    corners = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    cells = np.stack(corners, -1).reshape(-1, 4)
    cells = cells[np.all(xyz[cells, 2] > lowest, axis=1)]
    used, cells = np.unique(cells, return_inverse=True)
    return HeightField(xyz[used], cells.reshape(-1, 4))


def height_map(body: RigidBody, x: Array, y: Array, lowest_mm: float = _LOWEST_MM) -> Array:
    """Return the height z (len(x), len(y)) of the body's surface seen from above.

    Each point moves down from z = 0.1 mm by its distance from the body, at most to `lowest_mm`.
    """
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    z = np.full(len(xy), _TOP_MM)
    falling = np.arange(len(xy))
    for _ in range(_MAX_ITERATIONS):
        gap = body.distance(np.column_stack([xy[falling], z[falling]])).gap
        z[falling] = np.maximum(z[falling] - gap, lowest_mm)
        falling = falling[(np.abs(gap) > _TOLERANCE_MM) & (z[falling] > lowest_mm)]
        if not len(falling):
            break
    return z.reshape(len(x), len(y))
