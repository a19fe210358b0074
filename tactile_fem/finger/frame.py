"""The finger's axes in the coordinates of a scanner or a segmentation.

X goes across the finger, Y towards the tip, Z from the pad to the nail; the origin is where the
pad is touched. What the study does not give is found from the surfaces.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.simplex import Indices
from tactile_fem.runtime.triangles import Triangles

logger = logging.getLogger(__name__)

_END_SHARE = 0.1  # of a body's length, at its ends, in which its thickness is compared
_LEAST_OFFSET_MM = 0.3  # of bone or nail from the middle of the skin, to show where the nail is
_LEAST_SINE = 0.17  # of the angle between the directions to tip and nail: 10 degrees
_FIT_RADIUS_MM, _COEFFICIENTS = 3.0, 6  # of the paraboloid that is fitted to the pad
_LEVEL_ITERATIONS = 5


@dataclass(frozen=True)
class Frame:
    """Axes and origin of the finger in mm of the file's coordinates.

    `axes` (3, 3) has the unit vectors X, Y, Z as rows, `origin` is (3,).
    """

    axes: Array
    origin: Array

    def to_finger(self, points: Array) -> Array:
        """Return points (n, 3) of the file in the finger's axes."""
        return (points - self.origin) @ self.axes.T

    def from_finger(self, place: Array) -> Array:
        """Return the file's coordinates of a place (3,) in the finger's axes."""
        return self.origin + place @ self.axes


def frame_of(
    finger: Finger, skin: Triangles | None, bone: Triangles | None, nail: Triangles | None
) -> Frame:
    """Return the finger's frame; that of a bone alone has its origin at the bone's distal end.

    Raises
    ------
    MeshError
        Directions are parallel, or where the nail lies cannot be found.
    """
    body = skin or bone
    tip = np.array(finger.tip_direction or _towards_tip(body))
    tip /= np.linalg.norm(tip)
    up = np.array(finger.nail_direction or _towards_nail(skin, nail or bone, tip))
    up = up / np.linalg.norm(up)
    up -= (up @ tip) * tip
    if np.linalg.norm(up) < _LEAST_SINE:
        given = "given" if finger.tip_direction else "not given: the longest axis of the file"
        raise MeshError(
            "finger.nail_direction must not be parallel to finger.tip_direction, which is "
            f"{[round(float(x), 3) for x in tip]} ({given})"
        )
    if finger.nail_direction:
        _check_up(up, tip, skin, bone, nail)
    frame = Frame(_axes(tip, up), body.points[np.argmax(body.points @ tip)])
    if skin is None:
        return frame
    if finger.contact_mm is not None:
        return Frame(frame.axes, np.array(finger.contact_mm))
    if finger.nail_direction is not None:
        return Frame(frame.axes, _lowest(frame, skin))
    return _levelled(frame, skin, finger.contact_from_tip_mm)


def _axes(tip: Array, up: Array) -> Array:
    """Return unit vectors X, Y, Z: Y along `tip`, Z close to `up`."""
    x = np.cross(tip, up)
    x /= np.linalg.norm(x)
    return np.array([x, tip, np.cross(x, tip)])


def _towards_tip(body: Triangles) -> Array:
    """Return the longest axis of a body, towards its thinner end."""
    centred = body.points - body.points.mean(axis=0)
    axis: Array = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    along = centred @ axis
    low, high = along.min(), along.max()
    reach = _END_SHARE * (high - low)
    aside = np.linalg.norm(centred - along[:, None] * axis, axis=1)
    thick = [np.max(aside[end]) for end in (along < low + reach, along > high - reach)]
    return axis if thick[0] > thick[1] else -axis


def _check_up(
    up: Array, tip: Array, skin: Triangles | None, bone: Triangles | None, nail: Triangles | None
) -> None:
    """Refuse a direction away from the nail, and warn of one away from the bone."""
    for inner, name in ((nail, "nail"), (bone, "bone")):
        offset = _offset(skin, inner, tip)
        if offset is None or offset @ up > -_LEAST_OFFSET_MM * np.linalg.norm(up):
            continue
        message = f"finger.nail_direction points away from the {name} in finger.{name}_file"
        if inner is nail:
            raise MeshError(f"{message}: turn it round")
        logger.warning("%s, which lies nearer to the nail than to the pad: turn it round?", message)


def _towards_nail(skin: Triangles | None, inner: Triangles | None, tip: Array) -> list[float]:
    """Return the direction from the middle of the skin to the middle of nail or bone."""
    offset = _offset(skin, inner, tip)
    if offset is not None and np.linalg.norm(offset) > _LEAST_OFFSET_MM:
        return offset.tolist()
    raise MeshError(
        "finger.nail_direction must be given: where the nail is cannot be found without a skin "
        "and a bone or nail that lies off its middle"
    )


def _offset(skin: Triangles | None, inner: Triangles | None, tip: Array) -> Array | None:
    """Return how far nail or bone lie off the middle of the skin around them, (3,)."""
    if skin is None or inner is None:
        return None
    centres, inner_centres = skin.corners.mean(axis=1), inner.corners.mean(axis=1)
    along, ends = centres @ tip, inner_centres @ tip
    around = (along > ends.min()) & (along < ends.max())
    if not around.any():
        return None
    middle = np.average(centres[around], axis=0, weights=skin.areas[around])
    offset: Array = np.average(inner_centres, axis=0, weights=inner.areas) - middle
    return offset - (offset @ tip) * tip


def _lowest(frame: Frame, skin: Triangles) -> Array:
    """Return the pad's lowest point in the file, of a smooth surface through its neighbours."""
    points = frame.to_finger(skin.points)
    guess = points[np.argmin(points[:, 2])]
    height = _paraboloid(points, skin.triangles, guess[:2])
    slope, bend = height[1:3], np.array([[2 * height[3], height[4]], [height[4], 2 * height[5]]])
    aside = np.zeros(2)
    if np.all(np.linalg.eigvalsh(bend) > 1e-6):
        aside = np.clip(-np.linalg.solve(bend, slope), -_FIT_RADIUS_MM, _FIT_RADIUS_MM)
    return frame.from_finger(np.array([*(guess[:2] + aside), guess[2]]))


def _levelled(frame: Frame, skin: Triangles, from_tip_mm: float) -> Frame:
    """Turn a frame until the pad is level at a distance from the tip, the new origin."""
    tip_end = frame.origin
    for _ in range(_LEVEL_ITERATIONS):
        frame = Frame(frame.axes, tip_end)
        points = frame.to_finger(skin.points)
        y = points[:, 1].max() - from_tip_mm
        ring = points[np.abs(points[:, 1] - y) < _FIT_RADIUS_MM]
        if not len(ring):
            raise MeshError(
                f"finger.contact_from_tip_mm = {from_tip_mm:g} lies beyond the scanned skin"
            )
        x = (ring[:, 0].min() + ring[:, 0].max()) / 2
        z, across, along = _paraboloid(points, skin.triangles, np.array([x, y]))[:3]
        origin = frame.from_finger(np.array([x, y, z]))
        up = np.array([-across, -along, 1.0]) @ frame.axes
        tip = frame.axes[1] - (frame.axes[1] @ up) * up / (up @ up)
        frame = Frame(_axes(tip / np.linalg.norm(tip), up), origin)
    return frame


def _paraboloid(points: Array, triangles: Indices, xy: Array) -> Array:
    """Return the coefficients of 1, x, y, x^2, xy, y^2 of the pad's height around a place."""
    near = _around(points, xy)
    if len(near) < _COEFFICIENTS:  # long triangles
        import trimesh  # takes 0.15 s

        corners = points[triangles, :2]
        beside = np.maximum(corners.min(axis=1) - xy, xy - corners.max(axis=1))
        around = triangles[beside.max(axis=1) < _FIT_RADIUS_MM]
        finer, _ = trimesh.remesh.subdivide_to_size(points, around, _FIT_RADIUS_MM / 3, 30)
        near = _around(finer, xy)
    if len(near) < _COEFFICIENTS:
        raise MeshError(
            "the scanned skin has no surface within 3 mm of the contact point: correct "
            "finger.nail_direction or finger.tip_direction, or give finger.contact_mm"
        )
    x, y = (near[:, :2] - xy).T
    terms = np.column_stack([np.ones_like(x), x, y, x**2, x * y, y**2])
    return np.linalg.lstsq(terms, near[:, 2], rcond=None)[0]


def _around(points: Array, xy: Array) -> Array:
    """Return those of the points (n, 3) that belong to the pad around a place."""
    near = points[np.linalg.norm(points[:, :2] - xy, axis=1) < _FIT_RADIUS_MM]
    return near[near[:, 2] < near[:, 2].min(initial=np.inf) + _FIT_RADIUS_MM]
