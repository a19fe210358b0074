"""Finds within a second the errors of a study that would stop its scan later."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger.build import layering
from tactile_fem.finger.load import load_finger, shipped_file
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.report import pad_thickness_mm
from tactile_fem.finger.shape import bone_shape, skin_shape
from tactile_fem.finger.skin import nail_outline, sizes_of
from tactile_fem.neuron import populations_of
from tactile_fem.receptors import place_all
from tactile_fem.stimulus import Path, RigidBody, make_body, make_path
from tactile_fem.study import Finger, Protocol, Study

# A press to a force is given up when this share of the pad is squeezed.
DEEPEST = 0.8
_TOUCH_TOLERANCE_MM = 1e-3


def check_study(study: Study) -> None:
    """Try stimulus, finger and receptors without meshing and without DOLFINx.

    Raises
    ------
    StudyError
        A glyph is missing, a mesh file lacks a tag, the lengths do not make a finger, a receptor
        lies outside it ...
    """
    body = make_body(study.stimulus)
    populations_of(study)
    finger = study.finger
    if finger.mesh_file is None:
        skin_shape(finger)
        bone_shape(finger)
        nail_outline(finger)
        layering(finger, sizes_of(finger).epidermis_rows)
        thickness = finger.pad_thickness_mm
        check_depth(study.protocol, make_path(study.protocol, DEEPEST * thickness), thickness)
    if finger.mesh_file is not None or shipped_file(finger) is not None:
        mesh = _loaded(finger)
        thickness = pad_thickness_mm(mesh)
        path = make_path(study.protocol, DEEPEST * thickness)
        check_depth(study.protocol, path, thickness)
        check_apart(body, path, mesh)
        place_all(study, mesh)


def check_depth(protocol: Protocol | None, path: Path, pad_thickness_mm: float) -> None:
    """Refuse to press the skin onto the bone or through it; an own path is no protocol's.

    Raises
    ------
    StudyError
        The depth is not less than what lies between skin and bone.
    """
    for number, (_, motion) in enumerate(path.plan(), 1):
        depth_mm = motion.places_mm[:, 2].max()
        if depth_mm >= pad_thickness_mm and motion.until_N is None:
            if protocol is None:
                what = f"parts.path (piece {number}) goes {depth_mm:g} mm deep"
            elif protocol.path is None:
                what = f"protocol.depth_mm is {depth_mm:g}"
            else:
                what = f"protocol.path (entry {number}) goes {depth_mm:g} mm deep"
            raise StudyError(
                f"{what} but must be less than {pad_thickness_mm:.4g}, the finger's thickness "
                "from skin to bone over the contact point"
            )


def check_apart(body: RigidBody, path: Path, finger: FingerMesh) -> None:
    """Raise StudyError if the body starts inside the finger."""
    gap = body.distance(finger.nodes - path.start_mm).gap
    worst = int(np.argmin(gap))
    if gap[worst] < -_TOUCH_TOLERANCE_MM:
        x, y, z = finger.nodes[worst]
        raise StudyError(
            f"stimulus: it starts {-gap[worst]:.3g} mm inside the finger, at X {x:.1f}, Y {y:.1f}, "
            f"Z {z:.1f} mm; the finger must lie above its highest plane, Z = {path.start_mm[2]:g}"
        )


@lru_cache(maxsize=1)
def _loaded(finger: Finger) -> FingerMesh:
    """Return a finger; a series' scans often share one."""
    return load_finger(finger)
