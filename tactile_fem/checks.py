"""Finds within a second what would stop a scan later."""

from __future__ import annotations

from tactile_fem.finger.layers import layering
from tactile_fem.finger.load import load_finger
from tactile_fem.finger.shape import bone_shape, skin_shape
from tactile_fem.finger.skin import nail_outline, sizes_of
from tactile_fem.stimulus import make_body
from tactile_fem.study import Study


def check_study(study: Study) -> None:
    """Try stimulus and finger without meshing and without DOLFINx.

    Raises
    ------
    StudyError
        A glyph is missing, a mesh file lacks a tag, the lengths do not make a finger ...
    """
    make_body(study.stimulus)
    finger = study.finger
    if finger.mesh_file is not None:
        load_finger(finger)
        return
    skin_shape(finger)
    bone_shape(finger)
    nail_outline(finger)
    layering(finger, sizes_of(finger).epidermis_rows)
