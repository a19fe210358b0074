"""The surfaces that a finger is meshed from: analytic ones, or scanned ones in their place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger.bone import ScannedBone
from tactile_fem.finger.mesh_data import lowest_facet
from tactile_fem.finger.scanned import ScannedSkin, Scans, nail_box
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import Array, Capsule, bone_shape, check_depth_of_bone, skin_shape
from tactile_fem.finger.skin import NailOutline, nail_outline
from tactile_fem.runtime.triangles import Triangles

# Of the points at which a scanned bone's distance from the skin is measured.
_BONE_STEP_MM = 0.4


@dataclass(frozen=True)
class Anatomy:
    """Skin, bone and nail in the finger's axes."""

    skin: Capsule | ScannedSkin
    bone: Capsule | ScannedBone
    nail: NailOutline

    @classmethod
    def of(cls, finger: Finger) -> Anatomy:
        """Make the surfaces that a study states.

        Raises
        ------
        MeshError
            The lengths or the scans do not make a finger.
        StudyError
            A file cannot be read.
        """
        if not finger.is_scanned:
            skin = skin_shape(finger)
            return cls(skin, bone_shape(finger, skin), nail_outline(finger, skin))
        scans = Scans.of(finger)
        if scans.skin is None:
            skin, by = skin_shape(finger), _place_of_bone(scans.bone, finger)
        else:
            skin, by = ScannedSkin.of(scans.skin, finger, scans.frame).on_the_plane()
        nail = nail_outline(finger, skin.capsule, scans.nail and nail_box(_moved(scans.nail, by)))
        if scans.bone is None:
            return cls(skin, bone_shape(finger, skin), nail)
        bone = ScannedBone.of(_moved(scans.bone, by), finger, skin.capsule.cut_y)
        check_depth_of_bone(skin, bone.sample(_BONE_STEP_MM), finger)
        return cls(skin, bone, nail)


def _moved(surface: Triangles, by: Array) -> Triangles:
    return Triangles(surface.points + by, surface.triangles)


def _place_of_bone(bone: Triangles, finger: Finger) -> Array:
    """Return how far a bone with its distal end at the origin moves into the analytic finger."""
    low, high = bone.points.min(axis=0), bone.points.max(axis=0)
    end = finger.contact_from_tip_mm - finger.bone_tip_gap_mm
    by = np.array([-(low[0] + high[0]) / 2, end - high[1], 0.0])
    facets = (bone.points + by)[bone.triangles]
    found = lowest_facet(0.0, 0.0, facets)
    if found is None:
        raise MeshError(
            "finger.bone_file: the bone does not lie over the contact point; lower "
            f"finger.bone_tip_gap_mm = {finger.bone_tip_gap_mm:g}"
        )
    facet, weights = found
    by[2] = finger.pad_thickness_mm - weights @ facets[facet, :, 2]
    return by
