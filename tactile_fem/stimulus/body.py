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


class Outline(Protocol):
    """A flat shape that can be raised from a plate.

    A method `gap`, if it has one, returns the signed distance (n,) faster, without derivatives.
    """

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""


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
class Embossed:
    """A flat outline raised by `relief` from a plate, its top edge rounded with `fillet`.

    The raised part is a rounded extrusion with its true distance in space; it joins the plate
    by a smooth minimum, twice continuously differentiable, that acts within `blend` mm of the
    foot only.
    """

    outline: Outline
    relief: float
    fillet: float
    blend: float = 0.2

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        whole = HalfSpace(self.relief).distance(points)
        raised, is_top = self._raised(points)
        over_plate = raised - whole.gap
        is_top &= over_plate <= -self.blend
        whole.gap[is_top] = raised[is_top]
        # The outline's derivatives take most of the time; top and plate are flat.
        sides = np.flatnonzero((over_plate < self.blend) & ~is_top)
        plate = Distance(whole.gap[sides], whole.normal[sides], whole.hessian[sides])
        united = smooth_minimum(self._extrusion(points[sides]), plate, self.blend)
        whole.gap[sides], whole.normal[sides] = united.gap, united.normal
        whole.hessian[sides] = united.hessian
        return whole

    def _raised(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the distance from the extrusion, and where it is that from its flat top."""
        xy, gap_alone = points[:, :2], getattr(self.outline, "gap", None)
        gap = gap_alone(xy) if gap_alone else self.outline.distance(xy).gap
        a, b = gap + self.fillet, points[:, 2] + self.fillet
        corner = (a > 0) & (b > 0)
        raised = np.where(corner, np.hypot(a, b), np.maximum(a, b)) - self.fillet
        return raised, ~corner & (a <= b)

    def _extrusion(self, points: Array) -> Distance:
        """Return the distance of ``{d <= 0, z <= 0}`` shrunk and swollen by the fillet radius."""
        planar = self.outline.distance(points[:, :2])
        a, b = planar.gap + self.fillet, points[:, 2] + self.fillet
        r, n, H = norm_of(np.column_stack([a, b]))
        corner = (a > 0) & (b > 0)
        wall = (a > b) & ~corner
        da = np.where(corner, n[:, 0], np.where(wall, 1.0, 0.0))
        db = np.where(corner, n[:, 1], np.where(wall, 0.0, 1.0))
        gap = np.where(corner, r, np.maximum(a, b)) - self.fillet
        normal = np.column_stack([da[:, None] * planar.normal, db])
        hessian = np.zeros((len(points), 3, 3))
        g = planar.normal
        bend = np.where(corner[:, None, None], H, 0.0)
        hessian[:, :2, :2] = (
            bend[:, 0, 0, None, None] * g[:, :, None] * g[:, None, :]
            + da[:, None, None] * planar.hessian
        )
        hessian[:, :2, 2] = hessian[:, 2, :2] = bend[:, 0, 1, None] * g
        hessian[:, 2, 2] = bend[:, 1, 1]
        return Distance(gap, normal, hessian)


@dataclass(frozen=True)
class United:
    """Raised outlines of different heights on one plate, the highest first."""

    levels: tuple[Embossed, ...]

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        first, *others = self.levels
        found = first.distance(points)
        for level in others:
            lower = level.distance(points + np.array([0.0, 0.0, first.relief - level.relief]))
            nearer = lower.gap < found.gap
            for name in ("gap", "normal", "hessian"):
                getattr(found, name)[nearer] = getattr(lower, name)[nearer]
        return found


@dataclass(frozen=True)
class Moved:
    """A body turned about Z by `angle` (rad), from X towards Y, then shifted by `shift` (x, y)."""

    body: RigidBody
    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        points = points - np.array([*self.shift, 0.0])
        if not self.angle:
            return self.body.distance(points)
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
        found = self.body.distance(self.plane.vectors(points))
        axes = np.array(self.plane.axes)
        normal = self.plane.within(found.normal)
        flat = np.linalg.norm(normal, axis=1) < _MIN_SLOPE
        normal[flat] = [0.0, 1.0]
        return Distance(found.gap, normal, found.hessian[:, axes[:, None], axes])


def in_plane(body: RigidBody, plane: Plane) -> RigidBody:
    """Return a body as the mechanics of a section, or of space, take it."""
    return body if plane.is_space else Cut(body, plane)
