"""Rigid bodies sampled: their distance on a grid, and the heights of their upper side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_fem.path.rotations import matrix, swept
from tactile_fem.stimulus.body import NEAR_MM, Array, RigidBody

# Of the grid: its step, the box of the finger's pad and its surroundings, from its lowest corner to
# its highest, and the height down to which a body that does not turn is shown.
_STEP_MM, _BOX_MM, _LOWEST_MM = 0.1, ((-9.0, -15.0, 0.0), (9.0, 15.0, 5.0)), -3.0
# Where the search for the surface along a vertical line begins, and how exact it is.
_TOP_MM, _TOLERANCE_MM = 0.1, 1e-4
_MAX_ITERATIONS = 100


@dataclass(frozen=True)
class DistanceGrid:
    """Signed distance on a grid in the body's frame, from `origin_mm` (3,) in steps.

    `gap_mm` (Z, Y, X) is at most 0.5 mm away from zero.
    """

    origin_mm: Array
    step_mm: float
    gap_mm: NDArray[np.float32]

    @property
    def is_empty(self) -> bool:
        """Whether the body does not come near the finger."""
        return bool(self.gap_mm.min() >= 0)

    def gap(self, points: Array) -> Array:
        """Return the distance at points (n, 3), linear between the grid's; 0.5 mm outside of it."""
        from tactile_fem.stimulus.spline import linear_between  # SciPy takes 0.3 s

        return linear_between(self.gap_mm.T, self.origin_mm, self.step_mm, points, beyond=NEAR_MM)

    @classmethod
    def of(cls, body: RigidBody, places_mm: Array, turns_rad: Array | None = None) -> DistanceGrid:
        """Sample a body where it comes near the finger, at places and turns (n, 3)."""
        low, high = (ends[:2] for ends in swept(*_BOX_MM, places_mm, turns_rad))
        x, y = (np.arange(a, b + _STEP_MM, _STEP_MM) for a, b in zip(low, high, strict=True))
        lowest = _LOWEST_MM
        if turns_rad is not None:  # it comes near the finger with its sides
            upright = float(matrix(turns_rad)[:, 2, 2].min())
            lowest -= _BOX_MM[1][0] * np.sqrt(max(1 - upright**2, 0.0))
        plane = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        layers: list[Array] = []
        # Downwards until a whole layer is inside: early for a plate, never for a ball.
        for z in np.arange(_STEP_MM / 2, lowest, -_STEP_MM):
            points = np.column_stack([plane, np.full(len(plane), z)])
            layers.append(np.clip(body.distance(points).gap, -NEAR_MM, NEAR_MM))
            if layers[-1].max() < 0:
                break
        gap = np.array(layers[::-1], dtype=np.float32).reshape(-1, len(y), len(x))
        return cls(np.array([x[0], y[0], z]), _STEP_MM, gap)


def height_map(body: RigidBody, x: Array, y: Array, lowest_mm: float = _LOWEST_MM) -> Array:
    """Return the height z (len(x), len(y)) of the body's surface seen from above.

    Each point moves down from z = 0.1 mm by its distance from the body, at most to `lowest_mm`.
    """
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    return heights_at(body, xy, lowest_mm).reshape(len(x), len(y))


def heights_at(body: RigidBody, xy: Array, lowest_mm: float = _LOWEST_MM) -> Array:
    """Return the height z (n,) of the body's surface seen from above at xy (n, 2)."""
    z = np.full(len(xy), _TOP_MM)
    falling = np.arange(len(xy))
    for _ in range(_MAX_ITERATIONS):
        gap = body.distance(np.column_stack([xy[falling], z[falling]])).gap
        z[falling] = np.maximum(z[falling] - gap, lowest_mm)
        falling = falling[(np.abs(gap) > _TOLERANCE_MM) & (z[falling] > lowest_mm)]
        if not len(falling):
            break
    return z
