"""The signed distance of a rigid body on a regular grid: its shape, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tactile_fem.stimulus.body import NEAR_MM, Array, RigidBody

_STEP_MM = 0.1
# Half the width and length of the finger and its surroundings; the body is shown down to a height.
_HALF_MM = np.array([9.0, 15.0])
_LOWEST_MM = -3.0


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
        place = ((points - self.origin_mm) / self.step_mm).T[::-1]
        return ndimage.map_coordinates(
            self.gap_mm, place, output=np.float64, order=1, mode="constant", cval=NEAR_MM
        )

    @classmethod
    def of(cls, body: RigidBody, places_mm: Array) -> DistanceGrid:
        """Sample a body where it comes near the finger, its places being (n, 3)."""
        low = -_HALF_MM - places_mm[:, :2].max(axis=0)
        high = _HALF_MM - places_mm[:, :2].min(axis=0)
        x, y = (np.arange(a, b + _STEP_MM, _STEP_MM) for a, b in zip(low, high, strict=True))
        plane = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        layers: list[Array] = []
        # Downwards until a whole layer is inside: early for a plate, never for a ball.
        for z in np.arange(_STEP_MM / 2, _LOWEST_MM, -_STEP_MM):
            points = np.column_stack([plane, np.full(len(plane), z)])
            layers.append(np.clip(body.distance(points).gap, -NEAR_MM, NEAR_MM))
            if layers[-1].max() < 0:
                break
        gap = np.array(layers[::-1], dtype=np.float32).reshape(-1, len(y), len(x))
        return cls(np.array([x[0], y[0], z]), _STEP_MM, gap)
