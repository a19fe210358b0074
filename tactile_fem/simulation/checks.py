"""Finds within a second the errors of a study that would stop its scan later."""

from __future__ import annotations

import logging

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger.layers import PRESETS
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.plane import AXES, Plane
from tactile_fem.neuron import fields_of
from tactile_fem.path import Path
from tactile_fem.simulation.parts import Parts
from tactile_fem.stimulus import RigidBody
from tactile_fem.stimulus.check import miss
from tactile_fem.study import Protocol, Stimulus, Study

logger = logging.getLogger(__name__)

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
    body = study.stimulus.body()
    fields_of(afferents.population() for afferents in study.populations)
    mesh = study.finger.check()
    if study.finger.is_parametric:
        _checked_path(study, study.finger.pad_thickness_mm, study.finger.section_plane)
    if mesh is not None:
        check_with_mesh(study, body, mesh)


def check_with_mesh(study: Study, body: RigidBody, mesh: FingerMesh) -> Path:
    """Try path, stimulus and receptors with a finger; return the path.

    Raises
    ------
    StudyError
        The body goes too deep, starts in the finger or leaves the plane of a section, or a
        receptor lies outside or far from the tissue that it feels.
    """
    path = _checked_path(study, mesh.pad_thickness_mm, mesh.plane)
    check_apart(body, path, mesh)
    study.lay_out(mesh)
    return path


def check_made(
    study: Study, body: RigidBody, path: Path, mesh: FingerMesh | None, parts: Parts
) -> None:
    """Try stimulus and path with the finger; own ones are no section's of the study.

    Raises
    ------
    StudyError
        The body goes too deep, starts in the finger or leaves the plane of a section.
    """
    assert mesh is not None
    check_section(study, path, mesh.plane, own_body=parts.body is not None)
    check_depth(None if parts.path else study.protocol, path, mesh.pad_thickness_mm)
    check_apart(body, path, mesh)


def _checked_path(study: Study, pad_thickness_mm: float, plane: Plane) -> Path:
    path = study.protocol.route(DEEPEST * pad_thickness_mm)
    check_depth(study.protocol, path, pad_thickness_mm)
    check_section(study, path, plane)
    return path


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


def tell_missed(body: RigidBody, path: Path, finger: FingerMesh) -> None:
    """Warn if the body does not touch the finger on its way: nothing is felt then."""
    missed = miss(body, path.places_mm(), finger.corners_of("skin"))
    if missed is not None:
        logger.warning("%s: correct stimulus.shift_mm or the protocol.", missed)


def check_section(study: Study, path: Path, plane: Plane, *, own_body: bool = False) -> None:
    """Refuse a path that leaves the plane of a section, and letters that it does not cut.

    Raises
    ------
    StudyError
        One or the other.
    """
    off = plane.distance_mm(path.places_mm())
    if off > _TOUCH_TOLERANCE_MM:
        along = plane.axes[0]
        raise StudyError(
            f"protocol: its path leaves the section's plane, {plane.equation}, by {off:.3g} mm; "
            f"slide along {AXES[along]} only, for example protocol.path with by_mm = "
            f"{'[0, -10]' if along else '[10, 0]'}, or choose another finger.plane"
        )
    boxes = [] if own_body else [shape.bounds for shape in study.stimulus.outlines()]
    if boxes and not any(plane.cuts(box) for box in boxes):
        across = plane.across
        raise StudyError(
            f"stimulus: the section's plane, {plane.equation}, cuts none of its raised parts, "
            f"which lie between {AXES[across]} {min(box[across] for box in boxes):.3g} and "
            f"{max(box[across + 2] for box in boxes):.3g} mm; choose another stimulus.shift_mm"
        )


def tell_resolution(stimulus: Stimulus, finger: FingerMesh) -> None:
    """Log which part of a stimulus' roughness the skin's facets can follow, and which would."""
    sentence = stimulus.resolution(
        finger.facet_size_mm, {name: size.pad for name, size in PRESETS.items()}
    )
    if sentence:
        logger.info("%s", sentence)
