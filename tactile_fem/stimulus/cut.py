"""A rigid body cut by the plane of a section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.finger.plane import Plane
from tactile_fem.stimulus.body import Array, Distance, RigidBody

# Where the distance grows across the plane only, no direction in the plane leads out of the body.
_LEAST_SLOPE = 1e-6


@dataclass(frozen=True)
class Cut:
    """A body in the coordinates of a plane.

    The level of the body's distance in space: zero on the contour of the cut body. Inside and
    outside it falls short of the distance in the plane where a wall meets the plane at a slant; so
    do gaps, not where contact sets in.

    Attributes
    ----------
    body
        In space.
    plane
        Through it, in the body's frame at displacement 0.
    """

    body: RigidBody
    plane: Plane

    def distance(self, points: Array) -> Distance:
        """Return the body's signed distance at points (n, 2) of the plane."""
        found = self.body.distance(self.plane.points(points))
        axes = np.array(self.plane.axes)
        normal = self.plane.within(found.normal)
        flat = np.linalg.norm(normal, axis=1) < _LEAST_SLOPE
        normal[flat] = [0.0, 1.0]
        return Distance(found.gap, normal, found.hessian[:, axes[:, None], axes])


def in_plane(body: RigidBody, plane: Plane) -> RigidBody:
    """Return a body as the mechanics of a section see it, or of space."""
    return body if plane.is_space else Cut(body, plane)
