"""The files of a scanned finger: what of them belongs to the finger, and its axes in them.

X goes across the finger, Y towards the tip, Z from the pad to the nail; the origin is where the
pad is touched. What the study does not give is found from the surfaces.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger import FingerSettings
from tactile_fem.shapes.surface_files import Array, Indices, Triangles, read_triangles

logger = logging.getLogger(__name__)

_SIZES_MM = 4.0, 300.0  # of skin, bone and nail
# A piece with less of the area of the largest one is an island: dirt, or noise of the scanner.
_ISLAND_SHARE = 0.05
_END_SHARE = 0.1  # of the length of a body, at its ends, where its thickness is compared
_LEAST_OFFSET_MM = 0.3  # of bone or nail from the middle of the skin, to show where the nail is
_LEAST_SINE = 0.17  # of the angle between the directions to tip and nail: 10 degrees
_FIT_RADIUS_MM, _COEFFICIENTS = 3.0, 6  # of the paraboloid that is fitted to the pad
_LEVEL_ITERATIONS = 5


@dataclass(frozen=True)
class Frame:
    """Axes (3, 3), X, Y, Z in rows, and origin (3,) of the finger in a file, mm."""

    axes: Array
    origin: Array

    def to_finger(self, points: Array) -> Array:
        """Return points (n, 3) of the file in the axes of the finger."""
        return (points - self.origin) @ self.axes.T

    def from_finger(self, place: Array) -> Array:
        """Return the coordinates in the file of a place (3,) in the finger."""
        return self.origin + place @ self.axes


@dataclass(frozen=True)
class Scans:
    """The surfaces of a finger in its own axes, which are a frame in the files; None: no file."""

    skin: Triangles | None = None
    bone: Triangles | None = None
    nail: Triangles | None = None
    frame: Frame = field(default_factory=lambda: Frame(np.eye(3), np.zeros(3)))

    @classmethod
    def of(cls, finger: FingerSettings) -> Scans:
        """Read the files of a finger and find its axes; raise StudyError if either fails."""
        if not finger.is_scanned:
            return cls()
        at = None if finger.contact_mm is None else np.array(finger.contact_mm)
        found: dict[str, Triangles | None] = {}
        for name in ("skin", "bone", "nail"):
            file, key = getattr(finger, f"{name}_file"), f"finger.{name}_file"
            surface = file and _without_islands(_read(file, key, finger), key, at)
            found[name] = surface and surface.outwards()
        frame = _frame_of(finger, **found)
        placed = {
            name: surface and replace(surface, points=frame.to_finger(surface.points))
            for name, surface in found.items()
        }
        return cls(**placed, frame=frame)


def _read(file: Path, key: str, finger: FingerSettings) -> Triangles:
    """Read a surface; raise MeshError if it cannot be that of a finger."""
    surface = read_triangles(file, key, finger.file_unit_mm)
    size, (least, most) = float(np.ptp(surface.points, axis=0).max()), _SIZES_MM
    if not least < size < most:
        raise MeshError(
            f"finger.file_unit_mm = {finger.file_unit_mm:g} makes the surface in {file} "
            f"{size:.3g} mm long, but it must be {least:g} to {most:g} mm"
        )
    return surface


# --- pieces --------------------------------------------------------------------------------------


def beyond(surface: Triangles, least_y: float) -> Triangles:
    """Return the triangles of a surface that reach beyond some Y; itself if all do."""
    return surface.part(surface.corners[..., 1].max(axis=1) > least_y)


def connected(surface: Triangles, at: Array) -> Triangles:
    """Return the piece that is next to a place (3,), with what lies within it."""
    piece = _pieces(surface)
    return surface.part(_surrounded(surface, piece, _next_to(surface, piece, at))[piece])


def _without_islands(surface: Triangles, key: str, at: Array | None) -> Triangles:
    """Leave out small pieces, and those that do not surround the one next to a place (3,)."""
    piece = _pieces(surface)
    area = np.bincount(piece, surface.areas)
    kept = area >= _ISLAND_SHARE * area.max()
    if at is not None:
        main = _next_to(surface, np.where(kept[piece], piece, -1), at)
        kept &= _surrounded(surface, piece, main)
    if not kept.all():
        logger.warning(
            "%s has %d separate pieces: %d of them, %.2g %% of the area, are left out.",
            key,
            len(kept),
            np.count_nonzero(~kept),
            100 * area[~kept].sum() / area.sum(),
        )
    return surface.part(kept[piece])


def _pieces(surface: Triangles) -> Indices:
    """Return the number of the connected piece of each triangle, (m,)."""
    from trimesh.graph import connected_component_labels  # takes 0.15 s

    return connected_component_labels(surface.edges(), len(surface.points))[surface.triangles[:, 0]]


def _next_to(surface: Triangles, piece: Indices, at: Array) -> int:
    """Return the piece with the vertex next to a place; negative ones do not count."""
    distance = np.linalg.norm(surface.corners - at, axis=2).min(axis=1)
    return int(piece[np.argmin(np.where(piece < 0, np.inf, distance))])


def _surrounded(surface: Triangles, piece: Indices, main: int) -> NDArray[np.bool_]:
    """Return which pieces have their middle in the box of one of them."""
    low, high = np.full((piece.max() + 1, 3), np.inf), np.full((piece.max() + 1, 3), -np.inf)
    np.minimum.at(low, piece, surface.corners.min(axis=1))
    np.maximum.at(high, piece, surface.corners.max(axis=1))
    middle = (low + high) / 2
    return np.all((middle >= low[main]) & (middle <= high[main]), axis=1)


# --- axes ----------------------------------------------------------------------------------------


def _frame_of(
    finger: FingerSettings, skin: Triangles | None, bone: Triangles | None, nail: Triangles | None
) -> Frame:
    """Return the frame of the finger; without skin its origin is the distal end of the bone."""
    body = skin or bone
    assert body is not None
    tip = np.array(finger.tip_direction or _towards_tip(body))
    tip /= np.linalg.norm(tip)
    offsets = {"nail": _offset(skin, nail, tip), "bone": _offset(skin, bone, tip)}
    towards_nail = finger.nail_direction or offsets["bone" if nail is None else "nail"]
    if towards_nail is None or np.linalg.norm(towards_nail) < _LEAST_OFFSET_MM:
        raise MeshError(
            "finger.nail_direction must be given: where the nail is cannot be found without a skin "
            "and a bone or nail that lies off its middle"
        )
    up = np.array(towards_nail) / np.linalg.norm(towards_nail)
    up -= (up @ tip) * tip
    if np.linalg.norm(up) < _LEAST_SINE:
        given = "given" if finger.tip_direction else "not given: the longest axis of the file"
        raise MeshError(
            "finger.nail_direction must not be parallel to finger.tip_direction, which is "
            f"{[round(float(x), 3) for x in tip]} ({given})"
        )
    if finger.nail_direction:
        _check_up(up, offsets)
    frame = Frame(_axes(tip, up), body.points[np.argmax(body.points @ tip)])
    if skin is None:
        return frame
    if finger.contact_mm is not None:
        return replace(frame, origin=np.array(finger.contact_mm))
    if finger.nail_direction is not None:
        return replace(frame, origin=_lowest(frame, skin))
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


def _check_up(up: Array, offsets: dict[str, Array | None]) -> None:
    """Refuse a direction away from the nail, and warn of one away from the bone."""
    for name, offset in offsets.items():
        if offset is None or offset @ up > -_LEAST_OFFSET_MM * np.linalg.norm(up):
            continue
        message = f"finger.nail_direction points away from the {name} in finger.{name}_file"
        if name == "nail":
            raise MeshError(f"{message}: turn it round")
        logger.warning("%s, which lies nearer to the nail than to the pad: turn it round?", message)


def _lowest(frame: Frame, skin: Triangles) -> Array:
    """Return the lowest point of a smooth surface through the pad, in the file."""
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
        frame = replace(frame, origin=tip_end)
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
    """Return the coefficients of 1, x, y, x^2, xy, y^2 in the height of the pad around a place."""
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
