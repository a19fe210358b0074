"""Everything that can be wrong with a study and own parts, found before any long work."""

from __future__ import annotations

import logging
import sys
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from tactile_fem.errors import StudyError, raise_all
from tactile_fem.finger import TISSUES, FingerMesh
from tactile_fem.finger.plane import AXES, Plane
from tactile_fem.neuron import Population, fields_of
from tactile_fem.neuron.fields import trial_histories
from tactile_fem.path import Path
from tactile_fem.path.loads import COMPONENTS, NORMAL
from tactile_fem.path.rotations import matrix
from tactile_fem.results.columns import TRACE
from tactile_fem.results.measured import check_measured
from tactile_fem.runtime.own_code import Code
from tactile_fem.simulation.parts import NO_PARTS, Parts
from tactile_fem.stimulus import RigidBody
from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.check import check_body, check_lipschitz, miss, too_fine, too_sharp
from tactile_fem.study import Plate, Solver, Study, Tissue

if TYPE_CHECKING:
    from tactile_fem.tissue.energies import Law

logger = logging.getLogger(__name__)

# A press to a force is given up at this share of the thickness of the pad.
LARGEST_DEPTH_SHARE = 0.8
_MAX_POSES = 1000  # of a recorded path, along which sharp edges are sought
_TOUCH_TOLERANCE_MM = _TURN_TOLERANCE_DEG = 1e-3
# Where laws are tried: small deformations of either sign.
_DEFORMATIONS = (
    np.eye(3),
    np.array([[1.02, 0.05, 0.0], [0.0, 0.97, 0.01], [0.0, 0.0, 1.01]]),
    np.array([[0.95, 0.0, 0.02], [0.03, 1.04, 0.0], [0.0, -0.04, 1.02]]),
)


def deepest_mm(study: Study, pad_thickness_mm: float) -> float:
    """Return the depth at which a press to a force is given up; a bone on its joint gives way."""
    gives_way_mm = study.joint.length_mm if study.joint else 0.0
    return LARGEST_DEPTH_SHARE * pad_thickness_mm + gives_way_mm


def check(study: Study, parts: Parts = NO_PARTS) -> FingerMesh | None:
    """Try everything that needs neither a new mesh nor a solver.

    Returns
    -------
    FingerMesh or None
        The finger, if it is not to be meshed: it has been tried too, see `checked_mesh`.

    Raises
    ------
    StudyError
        A line for each fault: a glyph is missing, a mesh file lacks a tag, the lengths do not make
        a finger, a receptor lies outside it, an own part cannot be used ...
    """
    found: list[FingerMesh | None] = []
    raise_all(
        lambda: check_parts(parts),
        lambda: _check_options(study.solver),
        study.solver.own_terms,
        lambda: _check_afferents(study),
        lambda: found.append(_check_finger(study, parts)),
        lambda: _check_laws(study.tissue, parts, found[0] if found else None),
        lambda: _check_path_alone(study, parts),
        lambda: _check_stimulus(study, parts),
        lambda: study.stimulus.law().over_body(),  # reads its file
    )
    if mesh := found[0]:
        _check_with_mesh(study, mesh, parts)
    return mesh


def checked_mesh(study: Study, parts: Parts = NO_PARTS) -> FingerMesh:
    """Try everything that needs no solver; return the finger, meshed if it has to be.

    Raises
    ------
    StudyError
        As `check`; the body goes too deep, starts in the finger or leaves the plane of a section,
        or the plane cuts none of the raised parts of the study's stimulus; there is nothing to
        compare with a recording; a receptor lies outside or far from the tissue that it feels.
    """
    mesh = check(study, parts)
    if mesh is None:
        mesh = study.finger.mesh()
        _check_with_mesh(study, mesh, parts)
    return mesh


def _check_with_mesh(study: Study, mesh: FingerMesh, parts: Parts) -> None:
    """Try path, stimulus and receptors with a finger."""
    path = path_of(study, mesh.pad_thickness_mm, parts)
    raise_all(
        lambda: _check_path(study, path, mesh.pad_thickness_mm, mesh.plane, parts),
        lambda: check_measured(study, path),
        lambda: _check_friction(study, path, mesh),
        lambda: _check_start(parts.body or study.stimulus.body(), path, mesh),
        lambda: study.lay_out(mesh),
    )


def path_of(study: Study, pad_thickness_mm: float, parts: Parts = NO_PARTS) -> Path:
    """Return the path of the body."""
    return parts.path or study.protocol.route(deepest_mm(study, pad_thickness_mm))


def check_parts(parts: Parts) -> None:
    """Try own parts but laws, which need the finger; raise a StudyError for what cannot be used."""
    raise_all(
        parts.identity,
        *(partial(_check_tissue, tissue) for tissue in parts.laws),
        *(partial(_check_own_body, body) for body in [parts.body] if body is not None),
        *(partial(_check_own_path, path) for path in [parts.path] if path is not None),
        *(partial(_check_population, population) for population in parts.populations),
    )


def _check_tissue(name: str) -> None:
    if name not in TISSUES:
        raise StudyError(f'parts.laws: "{name}" is no tissue; allowed: {", ".join(TISSUES)}.')


def _check_laws(tissues: Tissue, parts: Parts, mesh: FingerMesh | None) -> None:
    """Try the laws that are not those of the package, with the fields of the finger."""
    of_parts = {name: law for name, law in parts.laws.items() if name in TISSUES}
    of_study = {name: law for name, law in tissues.own_laws().items() if name not in parts.laws}
    raise_all(
        *(partial(_check_law, "parts.laws", *own, tissues, mesh) for own in of_parts.items()),
        *(partial(_check_law, "tissue", *own, tissues, mesh) for own in of_study.items()),
    )


def _check_law(start: str, tissue: str, law: Law, tissues: Tissue, mesh: FingerMesh | None) -> None:
    energies = [_energy(law, F, mesh) for F in _DEFORMATIONS]
    if not np.isfinite(energies).all():
        raise StudyError(
            f"{start}: the energy of {tissue} is not a finite number at a small strain."
        )
    if min(energies[1:]) <= energies[0]:
        raise StudyError(
            f"{start}: the energy of {tissue} is not larger at a small strain than at rest."
        )
    if getattr(tissues, tissue).g and not hasattr(law, "in_shear"):
        raise StudyError(
            f"{start}: {tissue} relaxes (tissue.{tissue}.g), so its law needs a method "
            "in_shear(a, at), its energy in the simple shear gamma^2 = a."
        )


def _energy(law: Law, F: np.ndarray, mesh: FingerMesh | None) -> float:
    """Return the energy density of a law at a deformation gradient, (3, 3), in the first cell."""
    import ufl  # takes a while

    from tactile_fem.tissue.energies import ORIGIN, At, Fields

    first = {name: own[0].tolist() for name, own in (mesh.fields if mesh else {}).items()}
    fields = {name: ufl.as_tensor(x) if isinstance(x, list) else x for name, x in first.items()}
    at = At(ORIGIN.X, Fields(fields))
    energy = ufl.as_ufl(law.energy(ufl.as_matrix(F.tolist()), at))
    return float(energy(())) if energy.ufl_shape == () else np.nan


def _check_own_body(body: RigidBody) -> None:
    check_body(body, "parts.body")
    check_lipschitz(body, "parts.body")


def _check_own_path(path: Path) -> None:
    if not path.pieces:
        raise StudyError("parts.path: it has no pieces but needs one or more.")
    path.check()


def _check_population(population: Population) -> None:
    """Let it fire on an artificial trace of one receptor."""
    trial = trial_histories(fields_of([population]))
    steps, receptors = len(trial["time_s"]), 1
    rest = {
        column.name: np.broadcast_to(column.rest, column.sizes(steps=steps, receptors=receptors))
        for column in TRACE
    }
    population.fire({**rest, **trial})


def _check_afferents(study: Study) -> None:
    """Try what populations feel, also where that is code of the study's own."""
    populations = [afferents.population() for afferents in study.populations]
    fields_of(populations)
    for afferents, population in zip(study.populations, populations, strict=True):
        if isinstance(afferents.feels, Code):
            try:
                _check_population(population)
            except StudyError as error:
                raise StudyError(f"{study.table_of(afferents)}feels: {error}") from None


def _check_options(solver: Solver) -> None:
    """Let PETSc read its options, if there may be any and it is here: its import takes a while."""
    if "petsc4py.PETSc" in sys.modules or (solver.petsc and find_spec("petsc4py")):
        from tactile_fem.solvers.options import check_options

        check_options(solver)


def _check_stimulus(study: Study, parts: Parts) -> None:
    if parts.body is None:
        check_body(study.stimulus.body(), "stimulus")


def _check_finger(study: Study, parts: Parts) -> FingerMesh | None:
    if parts.finger is None:
        return study.finger.check()
    study.finger.check_mesh(parts.finger)
    return parts.finger


def _check_path_alone(study: Study, parts: Parts) -> None:
    """Try the study's path with the thickness that a finger states, before it is meshed."""
    finger = study.finger
    if finger.is_parametric and parts.finger is None and parts.path is None:
        thickness_mm = finger.pad_thickness_mm
        path = path_of(study, thickness_mm)
        _check_path(study, path, thickness_mm, finger.section_plane, parts)


def _check_start(body: RigidBody, path: Path, mesh: FingerMesh) -> None:
    """Refuse a body that starts inside the finger."""
    gap = body.distance((mesh.nodes - path.start_mm) @ matrix(path.start_rad)).gap
    worst = int(np.argmin(gap))
    if gap[worst] < -_TOUCH_TOLERANCE_MM:
        x, y, z = mesh.nodes[worst]
        raise StudyError(
            f"stimulus: it starts {-gap[worst]:.3g} mm inside the finger, at X {x:.1f}, Y {y:.1f}, "
            f"Z {z:.1f} mm; the finger must lie above its highest plane, Z = {path.start_mm[2]:g}"
        )


def _check_path(
    study: Study, path: Path, pad_thickness_mm: float, plane: Plane, parts: Parts
) -> None:
    """Refuse to press the skin onto the bone or through it, and a path out of a section's plane."""
    for number, (_, motion) in enumerate(path.plan(), 1):
        depth_mm = motion.places_mm[:, 2].max()
        is_held = motion.held is not None and NORMAL in motion.held.components
        yields = motion.until_N is not None or is_held or study.joint is not None
        if depth_mm >= pad_thickness_mm and not yields:
            if parts.path is not None:
                what = f"parts.path (piece {number}) goes {depth_mm:g} mm deep"
            elif study.protocol.path is None:
                what = f"protocol.depth_mm is {depth_mm:g}"
            else:
                what = f"protocol.path (entry {number}) goes {depth_mm:g} mm deep"
            raise StudyError(
                f"{what} but must be less than {pad_thickness_mm:.4g}, the finger's thickness "
                "from skin to bone over the contact point"
            )
    if parts.body is None and isinstance(study.stimulus, Plate):
        _check_force_along(study.stimulus, path)
    if not plane.is_space:
        _check_section(study, path, plane, parts)


def _check_friction(study: Study, path: Path, mesh: FingerMesh) -> None:
    """Refuse a law of friction that is unknown where the body may touch the undeformed finger.

    How deep a force presses is not known: then it is where contact begins.
    """
    law = study.stimulus.law()
    if law.over_body() is None:
        return
    places_mm = path.places_mm()
    if any(motion.until_N is not None or motion.held is not None for _, motion in path.plan()):
        places_mm[:, 2] = np.minimum(places_mm[:, 2], 0.0)
    if box := _touched(mesh, np.hstack([places_mm, path.turns_rad()])):
        law.check_covers(*box)


def _touched(mesh: FingerMesh, poses: Array) -> tuple[Array, Array] | None:
    """Return the corners (2,), in X and Y of a body, of where it may touch the undeformed finger.

    That is where skin lies below its highest plane, in any of its places and turns (n, 6).
    """
    skin = np.unique(mesh.corners_of("skin").reshape(-1, 3), axis=0)
    corners = []
    for pose in np.unique(poses, axis=0):
        own = (skin - pose[:3]) @ matrix(pose[3:])
        touched = own[own[:, 2] <= _TOUCH_TOLERANCE_MM, :2]
        corners += [touched.min(axis=0), touched.max(axis=0)] if len(touched) else []
    return (np.min(corners, axis=0), np.max(corners, axis=0)) if corners else None


def _check_force_along(plate: Plate, path: Path) -> None:
    """Refuse to hold more force along a plate than friction carries."""
    friction = plate.law().uniform
    for number, (_, motion) in enumerate(path.plan(), 1):
        held = motion.held
        if friction is None or held is None or not {0, 1, NORMAL} <= {*held.components}:
            continue
        loads = np.array([held.at(t, np.zeros(len(COMPONENTS))) for t in motion.times_s])
        along, normal = np.hypot(loads[:, 0], loads[:, 1]), loads[:, NORMAL]
        worst = int(np.argmax(along - friction * normal))
        if along[worst] > friction * normal[worst]:
            raise StudyError(
                f"protocol.path (entry {number}) holds {along[worst]:.3g} N along the plate with "
                f"{normal[worst]:.3g} N on it, but friction carries {friction:g} times as much at "
                "most: hold less, or raise stimulus.friction"
            )


def _check_section(study: Study, path: Path, plane: Plane, parts: Parts) -> None:
    """Refuse a path that leaves the plane of a section, and letters that it does not cut."""
    off = float(np.abs(path.places_mm()[:, plane.outside]).max(initial=0.0))
    if off > _TOUCH_TOLERANCE_MM:
        along = plane.axes[0]
        raise StudyError(
            f"protocol: its path leaves the section's plane, {plane.equation}, by {off:.3g} mm; "
            f"slide along {AXES[along]} only, for example protocol.path with by_mm = "
            f"{'[0, -10]' if along else '[10, 0]'}, or choose another finger.plane"
        )
    turn_deg = float(np.degrees(np.abs(path.turns_rad()[:, list(plane.axes)]).max(initial=0.0)))
    if turn_deg > _TURN_TOLERANCE_DEG:
        raise StudyError(
            f"protocol: its path turns the body by {turn_deg:.3g} degrees out of the section's "
            f"plane, {plane.equation}; let it roll about {AXES[plane.across]} only"
        )
    held = [k for _, motion in path.plan() if motion.held for k in motion.held.components]
    if wrong := [COMPONENTS[k] for k in held if k not in plane.axes]:
        raise StudyError(
            f"protocol: its path holds a load along {wrong[0]}, which is not in the section's "
            f"plane, {plane.equation}"
        )
    outlines = [] if parts.body is not None else study.stimulus.outlines()
    boxes = [shape.bounds for shape in outlines]
    if boxes and not any(plane.cuts(box) for box in boxes):
        across = plane.across
        raise StudyError(
            f"stimulus: the section's plane, {plane.equation}, cuts none of its raised parts, "
            f"which lie between {AXES[across]} {min(box[across] for box in boxes):.3g} and "
            f"{max(box[across + 2] for box in boxes):.3g} mm; choose another stimulus.shift_mm"
        )


def warn_if_missed(body: RigidBody, path: Path, finger: FingerMesh) -> None:
    """Warn if the body does not touch the finger on its way: nothing is felt then."""
    missed = miss(body, path.places_mm(), finger.corners_of("skin"), path.turns_rad())
    if missed is not None:
        logger.warning("%s: correct stimulus.shift_mm or the protocol.", missed)


def warn_if_sharp(body: RigidBody, path: Path, finger: FingerMesh) -> None:
    """Warn if the body on its way is too sharp or too fine for the skin's facets."""
    poses = np.hstack([path.places_mm(), path.turns_rad()])
    box = _touched(finger, poses[:: 1 + len(poses) // _MAX_POSES])
    size_mm = finger.facet_size_mm
    if box and (said := too_sharp(body, *box, size_mm) or too_fine(body, *box, size_mm)):
        logger.warning("stimulus: %s.", said)
