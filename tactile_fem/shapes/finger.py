"""Reads the files of a scanned finger, and draws them where they do not make one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger import (
    ClosedBone,
    FingerSettings,
    NailOutline,
    Skin,
    SurfaceFiles,
    lowest_height,
    skin_shape,
)
from tactile_fem.shapes.scans import Scans
from tactile_fem.shapes.surface_files import Array, Triangles

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class ScanFiles(SurfaceFiles):
    """Reads scans of skin, bone and nail: files of triangles."""

    def read(self) -> tuple[Skin | None, ClosedBone | None, NailOutline | None]:
        """Return skin, bone and nail in the finger's axes; None where no file is given."""
        from tactile_fem.shapes.scanned import ScannedBone, ScannedSkin  # SciPy takes a while

        scans, by = Scans.of(self.finger), np.zeros(3)
        skin: Skin | None = None
        if scans.skin:
            skin, by = ScannedSkin.of(scans.skin, self.finger, scans.frame).on_the_plane()
        elif scans.bone:
            by = _shift_of_bone(scans.bone, self.finger)
        cut_y = (skin or skin_shape(self.finger)).capsule.cut_y
        bone, nail = (one and one.moved(by) for one in (scans.bone, scans.nail))
        return (
            skin,
            ScannedBone.of(bone, self.finger, cut_y) if bone else None,
            _outline(nail) if nail else None,
        )

    def figure(self, place_mm: Sequence[float]) -> Figure:
        """Draw the scans in the finger's axes, and mark a place (3,) by a red ball."""
        from tactile_fem.output import surfaces_figure  # matplotlib takes a while

        scans = Scans.of(self.finger)
        found = {"stratum_corneum": scans.skin, "bone": scans.bone, "nail": scans.nail}
        return surfaces_figure({name: one for name, one in found.items() if one}, place_mm)


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


def _outline(nail: Triangles) -> NailOutline:
    low, high = nail.points.min(axis=0).tolist(), nail.points.max(axis=0).tolist()
    return NailOutline(max(-low[0], high[0]), low[1], high[1])
