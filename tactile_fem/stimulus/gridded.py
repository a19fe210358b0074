"""A body whose signed distance is known on a grid."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from tactile_fem.stimulus.body import NEAR_MM, Array, Distance
from tactile_fem.stimulus.spline import GridSpline

# Points at each end of the grid that serve the spline only: it is mirrored beyond them.
RIM = 4


@dataclass(frozen=True)
class Gridded:
    """A signed distance in mm on a grid (X, Y, Z), and the cubic spline through it."""

    values: Array
    spline: GridSpline

    @classmethod
    def of(cls, values: Array, origin: Array, step: float) -> Gridded:
        """Return the body of a signed distance on a grid from `origin` in steps of `step` mm."""
        return cls(values, GridSpline.through(values, origin, (step,) * 3))

    def raised(self, by: float) -> Gridded:
        """Return the body moved up by some mm."""
        origin = self.spline.origin + np.array([0.0, 0.0, by])
        return replace(self, spline=replace(self.spline, origin=origin))

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3).

        More than 0.5 mm above the surface it is linear between the grid's values, and the gradient
        points up. Beyond the grid it is continued: there as a constant, nearer in straight lines.
        """
        origin, step = self.spline.origin, self.spline.spacing
        first, last = np.full(3, RIM), np.array(self.values.shape) - 1 - RIM
        inside = np.clip(points, origin + step * first, origin + step * last)
        beyond = points - inside
        gap = ndimage.map_coordinates(self.values, ((inside - origin) / step).T, order=1)
        normal, hessian = np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros((len(points), 3, 3))
        near = np.flatnonzero(gap < NEAR_MM)
        value, slope, bend = self.spline.derivatives(inside[near], 2)
        beyond = beyond[near]
        for axis in range(3):
            bend[beyond[:, axis] != 0, axis] = 0.0
            bend[beyond[:, axis] != 0, :, axis] = 0.0
        gap[near] = value + np.einsum("ni,ni->n", slope, beyond)
        normal[near], hessian[near] = slope, bend
        return Distance(gap, normal, hessian)
