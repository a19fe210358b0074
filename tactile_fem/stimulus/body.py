"""Rigid bodies by their signed distance, gradient and Hessian.

Body frame: X across the finger, Y along it, Z up; the highest plane of the body is z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tactile_fem.finger.plane import Plane

Array = NDArray[np.float64]
# Near the surface a distance must be accurate; farther away it need only be at least this long.
NEAR_MM = 0.5
# Excess of a distance over the true one that the contact search allows for; see `Relief`.
EXCESS_MM = 0.06
_ZERO_MM = 1e-12
# Below this slope within the plane of a section, no direction in it leads out of the body.
_MIN_SLOPE = 1e-6


@dataclass(frozen=True)
class Distance:
    """Signed distance at points of space (d = 3) or of a plane (d = 2), negative inside.

    Attributes
    ----------
    gap, normal, hessian
        Value (n,) in mm, gradient (n, d) and second derivative (n, d, d) in 1/mm.
    """

    gap: Array
    normal: Array
    hessian: Array


class RigidBody(Protocol):
    """A body that the finger can touch.

    Its distance is 1-Lipschitz: between two points it changes by no more than their distance. The
    contact search relies on this within `NEAR_MM` of the surface: skin that moves by less than its
    distance is not evaluated again. The gradient vanishes nowhere outside.
    """

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3) in the body's frame."""


def norm_of(components: Array) -> tuple[Array, Array, Array]:
    """Return value, gradient and Hessian of the Euclidean norm of `components` (n, k).

    At the origin, where the gradient has no direction, it points along the last axis.
    """
    r = np.maximum(np.linalg.norm(components, axis=1), _ZERO_MM)
    n = components / r[:, None]
    n[r == _ZERO_MM] = np.eye(components.shape[1])[-1]
    identity = np.eye(components.shape[1])
    return r, n, (identity - n[:, :, None] * n[:, None, :]) / r[:, None, None]


def smooth_minimum(first: Distance, second: Distance, width: float) -> Distance:
    """Return the smaller of two distances, blended where they differ by less than `width`.

    ``min(f, s) = (f + s - m(f - s))/2`` with `m` a quartic that replaces the modulus.
    """
    t = np.clip((first.gap - second.gap) / width, -1.0, 1.0)
    inside = np.abs(t) < 1
    modulus = width * (3 + 6 * t**2 - t**4) / 8
    modulus = np.where(inside, modulus, np.abs(first.gap - second.gap))
    slope = np.where(inside, (3 * t - t**3) / 2, np.sign(t))
    bend = np.where(inside, 1.5 * (1 - t**2) / width, 0.0)
    difference = first.normal - second.normal
    share = (1 - slope) / 2
    return Distance(
        (first.gap + second.gap - modulus) / 2,
        share[:, None] * first.normal + (1 - share[:, None]) * second.normal,
        share[:, None, None] * first.hessian
        + (1 - share[:, None, None]) * second.hessian
        - bend[:, None, None] / 2 * difference[:, :, None] * difference[:, None, :],
    )


@dataclass(frozen=True)
class HalfSpace:
    """Everything below ``z = -depth``."""

    depth: float = 0.0

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        normal = np.zeros_like(points)
        normal[:, 2] = 1.0
        return Distance(points[:, 2] + self.depth, normal, np.zeros((len(points), 3, 3)))


@dataclass(frozen=True)
class Ball:
    """A ball of some radius in mm, its top at the origin.

    It is round in the `axes` (0, 1, 2); with (1, 2) it is a bar along X, with (0, 2) along Y.
    """

    radius: float
    axes: tuple[int, ...] = (0, 1, 2)

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        offset = points[:, self.axes].copy()
        offset[:, -1] += self.radius
        r, n, H = norm_of(offset)
        return in_space(self.axes, r - self.radius, n, H)


def in_space(axes: tuple[int, ...], gap: Array, gradient: Array, hessian: Array) -> Distance:
    """Return a distance that depends on k axes only; (n,), (n, k), (n, k, k)."""
    normal, H = np.zeros((len(gap), 3)), np.zeros((len(gap), 3, 3))
    normal[:, axes] = gradient
    H[:, np.array(axes)[:, None], axes] = hessian
    return Distance(gap, normal, H)


@dataclass(frozen=True)
class Moved:
    """A body shifted in its plane by `shift` (x, y) mm."""

    body: RigidBody
    shift: tuple[float, float]

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        return self.body.distance(points - np.array([*self.shift, 0.0]))


@dataclass(frozen=True)
class Turned:
    """A body turned about Z by `angle` (rad), from X towards Y."""

    body: RigidBody
    angle: float

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        own = self.body.distance(points @ R)
        return Distance(own.gap, own.normal @ R.T, R @ own.hessian @ R.T)


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
