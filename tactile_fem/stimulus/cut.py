"""A rigid body cut by the plane of a section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.finger.plane import Plane
from tactile_fem.stimulus.body import Array, Distance, RigidBody

# Below this slope within the plane, no direction in the plane leads out of the body.
_MIN_SLOPE = 1e-6


@dataclass(frozen=True)
class Cut:
    """A body in space, in the coordinates of a plane in the body's frame at displacement 0.

    Its distance is that in space: zero on the contour of the cut body. Where a wall meets the plane
    at a slant it is shorter than the distance in the plane, and so are gaps; where contact begins
    is exact.
    """

    body: RigidBody
    plane: Plane

    def distance(self, points: Array) -> Distance:
        """Return the body's signed distance at points (n, 2) of the plane."""
        found = self.body.distance(self.plane.points(points))
        axes = np.array(self.plane.axes)
        normal = self.plane.within(found.normal)
        flat = np.linalg.norm(normal, axis=1) < _MIN_SLOPE
        normal[flat] = [0.0, 1.0]
        return Distance(found.gap, normal, found.hessian[:, axes[:, None], axes])


def in_plane(body: RigidBody, plane: Plane) -> RigidBody:
    """Return a body as the mechanics of a section, or of space, take it."""
    return body if plane.is_space else Cut(body, plane)
