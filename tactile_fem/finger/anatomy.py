"""What a finger is meshed from: its surfaces, analytic or scanned, its layers and edge lengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.finger.layers import Layering, Ridges, Sizes, layering
from tactile_fem.finger.plane import Array
from tactile_fem.finger.scanned import ScannedBone, ScannedSkin
from tactile_fem.finger.scans import Scans
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.shape import Capsule, bone_shape, skin_shape
from tactile_fem.finger.simplex import lowest_height
from tactile_fem.runtime.files import cached_by_content
from tactile_fem.runtime.triangles import Triangles

if TYPE_CHECKING:
    import shapely

_NAIL_FROM_TIP_MM, _NAIL_FROM_CUT_MM = 1.0, 2.0
_NAIL_SHARE = 0.97  # share of the width of the finger
_LEAST_GAP_MM = 0.15  # bone to dermis
_DEPTH_STEP_MM = 0.25  # between points of the skin, from which depths are measured
_BONE_STEP_MM = 0.4  # between points of the bone, whose depth is checked


@dataclass(frozen=True)
class NailOutline:
    """Rounded rectangle in the XY plane (mm); the nail is its projection onto the dorsal side."""

    half_width: float
    start_y: float
    end_y: float

    @property
    def corner(self) -> float:
        """Radius of the corners."""
        return 0.9 * min(self.half_width, 0.5 * (self.end_y - self.start_y))

    @property
    def centres(self) -> tuple[float, float, float, float]:
        """Least X and Y, largest X and Y of the centres of the corners."""
        x, r = self.half_width - self.corner, self.corner
        return -x, self.start_y + r, x, self.end_y - r

    @property
    def polygon(self) -> shapely.Polygon:
        """The outline."""
        import shapely  # takes a while

        return shapely.box(*self.centres).buffer(self.corner, quad_segs=16)

    def ends(self, axis: int) -> tuple[float, float]:
        """Return its ends along X (0) or Y (1)."""
        return (self.start_y, self.end_y) if axis else (-self.half_width, self.half_width)


@dataclass(frozen=True)
class Anatomy:
    """A finger with its edge lengths and layers; its skin, bone and nail in its own axes."""

    finger: FingerSettings
    sizes: Sizes
    rows: Layering
    ridges: Ridges
    skin: Capsule | ScannedSkin
    bone: Capsule | ScannedBone
    nail: NailOutline

    @staticmethod
    @cached_by_content(maxsize=1)
    def of(finger: FingerSettings) -> Anatomy:
        """Make what a study states; the last one is kept, since scans of a series often share it.

        Raises MeshError if lengths or scans do not make a finger, StudyError if a file cannot be
        read.
        """
        ridges, sizes = Ridges(finger), Sizes.of(finger)
        rows = layering(finger, sizes.epidermis_rows)
        scans = Scans.of(finger)
        skin: Capsule | ScannedSkin
        bone: Capsule | ScannedBone
        if scans.skin:
            skin, by = ScannedSkin.of(scans.skin, finger, scans.frame).on_the_plane()
        else:
            skin = skin_shape(finger)
            by = _shift_of_bone(scans.bone, finger) if scans.bone else np.zeros(3)
        if scans.bone:
            bone = ScannedBone.of(scans.bone.moved(by), finger, skin.capsule.cut_y)
        else:
            bone = bone_shape(finger, skin.capsule)
        _check_depth_of_bone(skin, bone, finger)
        nail = _scanned_nail(scans.nail.moved(by)) if scans.nail else _nail(finger, skin.capsule)
        _check_nail(nail, skin.capsule)
        return Anatomy(finger, sizes, rows, ridges, skin, bone, nail)


def _shift_of_bone(bone: Triangles, finger: FingerSettings) -> Array:
    """Return how far a bone with its distal end at the origin moves into the analytic finger."""
    low, high = bone.points.min(axis=0), bone.points.max(axis=0)
    end = finger.contact_from_tip_mm - finger.bone_tip_gap_mm
    by = np.array([-(low[0] + high[0]) / 2, end - high[1], 0.0])
    height = lowest_height(0.0, 0.0, bone.moved(by).corners)
    if height is None:
        raise MeshError(
            "finger.bone_file: the bone does not lie over the contact point; lower "
            f"finger.bone_tip_gap_mm = {finger.bone_tip_gap_mm:g}"
        )
    by[2] = finger.pad_thickness_mm - height
    return by


def _nail(finger: FingerSettings, skin: Capsule) -> NailOutline:
    end = skin.tip_y - _NAIL_FROM_TIP_MM
    return NailOutline(0.5 * finger.nail_width_mm, end - finger.nail_length_mm, end)


def _scanned_nail(nail: Triangles) -> NailOutline:
    low, high = nail.points.min(axis=0).tolist(), nail.points.max(axis=0).tolist()
    return NailOutline(max(-low[0], high[0]), low[1], high[1])


def _check_nail(outline: NailOutline, skin: Capsule) -> None:
    """Raise MeshError if a nail is wider or longer than the back of the finger."""
    width, length = 2 * outline.half_width, outline.end_y - outline.start_y
    size = f"the nail ({width:.3g} mm wide, {length:.3g} mm long)"
    x, y = np.array(outline.polygon.exterior.coords).T
    room = skin.half_width * np.sqrt(skin.closing(y)[0])
    if np.any(np.abs(x) > _NAIL_SHARE * room):
        raise MeshError(f"{size} does not fit on the back of the finger")
    if outline.start_y < skin.cut_y + _NAIL_FROM_CUT_MM:
        raise MeshError(f"{size} comes too near to the proximal cut")


def _check_depth_of_bone(
    skin: Capsule | ScannedSkin, bone: Capsule | ScannedBone, finger: FingerSettings
) -> None:
    """Raise MeshError if a bone is closer to the skin than the layers allow."""
    bone_points, _ = bone.sample(_BONE_STEP_MM)
    depth = depth_below(skin, bone_points)
    need = finger.skin_thickness_mm + _LEAST_GAP_MM
    worst = int(np.argmin(depth))
    if depth[worst] < need:
        where = "outside the skin" if depth[worst] <= 0 else f"{depth[worst]:.2f} mm below the skin"
        raise PlaceError(
            f"the bone comes to lie {where} {{place}}, but the layers need {need:.2f} mm: use "
            "thinner layers, a smaller bone or a thicker finger",
            bone_points[worst],
        )


def depth_below(skin: Capsule | ScannedSkin, points: Array) -> Array:
    """Return the depth of points (n, 3) below the skin in mm, negative outside (error < 0.02)."""
    from scipy.spatial import cKDTree  # takes 0.3 s

    surface, _ = skin.sample(_DEPTH_STEP_MM)
    distance, _ = cKDTree(surface).query(points)
    return np.where(skin.level(points) < 0, distance, -distance)
