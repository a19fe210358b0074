"""Reads the files of a scanned finger, and draws them where they do not make one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.shape import skin_shape
from tactile_fem.finger.simplex import lowest_height
from tactile_fem.finger.surfaces import ClosedBone, NailOutline, Skin, SurfaceFiles
from tactile_fem.shapes.scans import Scans
from tactile_fem.shapes.surface_files import Triangles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The scans are seen from two sides, and a ball marks a place of them.
_EYES = {"From the side": (40.0, -10.0, 12.0), "From the pad": (10.0, -6.0, -40.0)}
_BALL_RADIUS_MM = 0.6


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
        import pyvista as pv  # it and matplotlib take a second

        from tactile_fem.output import scene
        from tactile_fem.output.annotations import COLOURS
        from tactile_fem.output.preview import PIXELS, new_figure, show_image

        scans, figure = Scans.of(self.finger), new_figure()
        for k, (name, eye) in enumerate(_EYES.items()):
            plotter = scene.new_plotter()
            colours = COLOURS["stratum_corneum"], COLOURS["bone"], COLOURS["nail"]
            surfaces = (scans.skin, 0.35), (scans.bone, 1.0), (scans.nail, 0.7)
            for (surface, opacity), colour in zip(surfaces, colours, strict=True):
                if surface is not None:
                    shape = pv.PolyData.from_regular_faces(surface.points, surface.triangles)  # type: ignore[arg-type]
                    plotter.add_mesh(shape, color=colour, opacity=opacity)
            ball = pv.Sphere(radius=_BALL_RADIUS_MM, center=place_mm)
            plotter.add_mesh(ball, color="red", lighting=False)
            scene.look_at(plotter, eye, (0.0, -2.0, 6.0), half_height_mm=16.0)
            show_image(figure, (0.5 * k, 0.02, 0.5, 0.9), scene.shot(plotter, *PIXELS), name)
        return figure


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
