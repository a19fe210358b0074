"""The signed distance of a rigid body on a regular grid: its shape, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from tactile_fem.stimulus.body import Array, RigidBody

_STEP_MM = 0.1
# The finger and its surroundings; the body is shown down to here.
_HALF_MM = np.array([9.0, 15.0])
_LOWEST_MM = -3.0
# Farther from the surface the distance itself does not matter.
_FAR_MM = 0.5


@dataclass(frozen=True)
class DistanceGrid:
    """Signed distance on a grid in the body's frame.

    Attributes
    ----------
    origin_mm, step_mm
        First point, (3,), and distance between points.
    gap_mm
        (Z, Y, X), at most 0.5 mm away from zero.
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
        axes = [
            start + self.step_mm * np.arange(count)
            for start, count in zip(self.origin_mm, self.gap_mm.shape[::-1], strict=True)
        ]
        values = RegularGridInterpolator(
            axes, self.gap_mm.T, bounds_error=False, fill_value=_FAR_MM
        )
        return np.asarray(values(points))

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
            layers.append(np.clip(body.distance(points).gap, -_FAR_MM, _FAR_MM))
            if layers[-1].max() < 0:
                break
        gap = np.array(layers[::-1], dtype=np.float32).reshape(-1, len(y), len(x))
        return cls(np.array([x[0], y[0], z]), _STEP_MM, gap)
