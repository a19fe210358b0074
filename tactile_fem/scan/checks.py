"""Finds within a second what would stop a scan later."""

from __future__ import annotations

from functools import lru_cache

from tactile_fem.errors import StudyError
from tactile_fem.finger.layers import layering
from tactile_fem.finger.load import load_finger, shipped_file
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.report import pad_thickness_mm
from tactile_fem.finger.shape import bone_shape, skin_shape
from tactile_fem.finger.skin import nail_outline, sizes_of
from tactile_fem.neuron import populations_of
from tactile_fem.receptors import place_all
from tactile_fem.stimulus import make_body
from tactile_fem.study import Finger, Protocol, Study


def check_study(study: Study) -> None:
    """Try stimulus, finger and receptors without meshing and without DOLFINx.

    Raises
    ------
    StudyError
        A glyph is missing, a mesh file lacks a tag, the lengths do not make a finger, a receptor
        lies outside it ...
    """
    make_body(study.stimulus)
    populations_of(study)
    finger = study.finger
    if finger.mesh_file is None:
        skin_shape(finger)
        bone_shape(finger)
        nail_outline(finger)
        layering(finger, sizes_of(finger).epidermis_rows)
        check_depth(study.protocol, finger.pad_thickness_mm)
    if finger.mesh_file is not None or shipped_file(finger) is not None:
        mesh = _loaded(finger)
        check_depth(study.protocol, pad_thickness_mm(mesh))
        place_all(study, mesh)


def check_depth(protocol: Protocol, pad_thickness_mm: float) -> None:
    """Refuse to press the skin onto the bone or through it.

    Raises
    ------
    StudyError
        The depth is not less than what lies between skin and bone.
    """
    if protocol.force_N is None and protocol.depth_mm >= pad_thickness_mm:
        raise StudyError(
            f"protocol.depth_mm is {protocol.depth_mm:g} but must be less than "
            f"{pad_thickness_mm:.4g}, the finger's thickness from skin to bone over the contact "
            "point"
        )


@lru_cache(maxsize=1)
def _loaded(finger: Finger) -> FingerMesh:
    """Return a finger; a series' scans often share one."""
    return load_finger(finger)
