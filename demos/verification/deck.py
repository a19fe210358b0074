"""Writes a study as an input deck for CalculiX: the same contact with another code.

Units are mm, N, MPa; step time is the share of a straight part of the path that is done. The deck
differs from this package's own model in four ways: contact is a linear penalty instead of
Nitsche's method, the stimulator is a facetted height field instead of a smooth distance,
tissues have neither viscosity nor mass (``tissue.viscous_time_s``, ``solver.inertia``), and
volume change is integrated at every point: coarse fat locks there (as with a
``solver.locking_ratio`` of 1e9 here).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import batched, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError, StudyError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, held_parts
from tactile_fem.finger.simplex import SOLID
from tactile_fem.path import Motion
from tactile_fem.path import Path as Route
from tactile_fem.runtime.files import write_text
from tactile_fem.stimulus import RigidBody
from tactile_fem.stimulus.check import miss
from tactile_fem.stimulus.sampled import height_map
from tactile_fem.study import Elastic, Protocol, Study
from tactile_fem.tissue.constants import Material
from tactile_fem.tissue.energies import bulk_modulus, shear_modulus

# The faces S1 to S4 of C3D10 are opposite to the corners 4, 3, 1 and 2.
C3D10_FACES = SOLID.facets[[3, 2, 0, 1]]
# CalculiX replaces a D2 of zero by its own value; this value removes the term.
NO_D_PER_MPa = 1e12
_THICKNESS_MM = 0.5
_SMALLEST_INCREMENT = 1e-5
# Skin and body that stay this far apart, by undeformed shapes, do not touch.
_MARGIN_MM = 0.5


@dataclass(frozen=True)
class Penalty:
    """Linear contact law: pressure over penetration, and shear over slip while the skin sticks."""

    stiffness_MPa_per_mm: float
    stick_MPa_per_mm: float

    @classmethod
    def of(cls, study: Study, finger: FingerMesh) -> Penalty:
        """Return Nitsche's stiffness ``gamma M/h`` with h the thickness of the stratum corneum.

        Sticking is ten times softer, because CalculiX then converges better and the skin creeps
        by only a few micrometres. A pad without stratum corneum raises MeshError.
        """
        layers = finger.layers_mm
        if "stratum_corneum" not in layers:
            raise MeshError(
                "the pad has no stratum corneum, whose thickness a deck's contact needs"
            )
        skin = study.tissue.stratum_corneum
        modulus_MPa = float(bulk_modulus(skin) + 4 * shear_modulus(skin) / 3)
        stiffness = study.solver.nitsche_gamma * modulus_MPa / layers["stratum_corneum"]
        return cls(stiffness, stiffness / 10)


@dataclass(frozen=True)
class DeckSize:
    """Number of tetrahedra, of free displacement components and of faces of the slave surface."""

    cells: int
    unknowns: int
    skin_facets: int


def write_deck(
    study: Study,
    finger: FingerMesh,
    path: Path | str,
    *,
    press_step_mm: float | None = None,
    slide_step_mm: float | None = None,
    grid_mm: tuple[float, float] = (0.1, 0.1),
    penalty: Penalty | None = None,
    energy_of: NDArray[np.int64] | None = None,
) -> DeckSize:
    """Write a study of a solid finger as an input deck.

    Nodes and tetrahedra keep the order of the mesh and are counted from 1. Parts in ``solver.held``
    are fixed as in this package: their tissues are left out, and the nodes that they share with
    others do not move. The sum of forces on the sets STIMULATOR (force on the finger) and HELD
    (its reaction) is printed for each increment.

    Parameters
    ----------
    press_step_mm, slide_step_mm
        Fixed increments towards the finger and across it, by default the longest ones that the
        study allows. The other code may halve them if it does not converge.
    grid_mm
        Spacing of the height field in X and Y.
    energy_of
        Tetrahedra, numbered as in the mesh, whose strain energy density is printed at their
        integration points for each increment; the set FELT.

    Raises
    ------
    StudyError
        The path wants a force or turns the stimulator, the stimulator does not touch the finger,
        nothing of the mesh is held, or tissue relaxes.
    """
    _check_goes_to_places(study.protocol)
    route = study.protocol.route(0.0)
    _check_only_moves(route)
    rigid, fixed = held_parts(finger, study.solver.held)
    deformable = np.flatnonzero(~rigid)
    used = np.unique(finger.cells[deformable])
    held = used[fixed[used]]
    if not len(held):
        raise StudyError(f"solver.held = {list(study.solver.held)}: nothing of the mesh is held")
    skin = finger.facets[finger.surface == SURFACES["skin"], :3]
    faces = _element_faces(finger.cells, skin)
    contact = penalty or Penalty.of(study, finger)
    body = study.stimulus.body()
    missed = miss(body, route.places_mm(), finger.nodes[skin])
    if missed is not None:
        raise StudyError(
            f"{missed}; a deck needs contact: correct stimulus.shift_mm or the protocol"
        )
    points, squares = height_field(body, route.places_mm(), finger.nodes[skin], grid_mm)
    if not len(squares):
        raise StudyError(f"nothing of the stimulator is wider than grid_mm = {list(grid_mm)}")

    present = [name for name, tag in TISSUES.items() if np.any(finger.tissue[deformable] == tag)]
    relaxing = [name for name in present if getattr(study.tissue, name).g]
    if relaxing:
        raise StudyError(
            f"tissue.{relaxing[0]}.g is set but CalculiX has no tissue that relaxes: set "
            'tissue.relaxation to "none".'
        )
    friction = study.stimulus.law()
    if friction.uniform is None:
        raise StudyError(
            f'stimulus.friction.law = "{friction.law}" is not written into a deck: give a number'
        )
    lines = ["** Fingertip and rigid stimulator, written by tactile_fem; mm, N, MPa"]
    lines += _finger_lines(finger, deformable, used, held, present)
    if energy_of is not None:
        lines += ["*ELSET, ELSET=FELT", *_listed(energy_of + 1)]
    counts = len(finger.nodes), len(finger.cells)
    lines += _stimulator_lines(points + route.start_mm, squares, *counts)
    for name in present:
        lines += material_lines(name, getattr(study.tissue, name))
    lines += _contact_lines(faces, friction.uniform, contact)
    printed = _print_lines(energy_of is not None)
    slide = slide_step_mm or study.solver.max_slide_step_mm
    press = press_step_mm or study.solver.max_press_step_mm
    for _, motion in route.plan():
        lines += _step_lines(motion, route.start_mm, (slide, press), printed)
    write_text(Path(path), "\n".join([*lines, ""]))
    return DeckSize(len(deformable), 3 * (len(used) - len(held)), len(faces))


def height_field(
    body: RigidBody, places_mm: NDArray, skin: NDArray, grid_mm: tuple[float, float]
) -> tuple[NDArray, NDArray[np.int64]]:
    """Sample that part of the upper surface that can touch the finger along the path, as squares.

    Parameters
    ----------
    places_mm
        Places of the body, (n, 3); it is sampled where it touches the undeformed pad.
    skin
        Undeformed points of the skin in mm, (..., 3).
    grid_mm
        Largest spacing in X and Y.

    Returns
    -------
    points, squares
        (n, 3) in mm, and (m, 4) points, counter-clockwise seen from above.
    """
    points = skin.reshape(-1, 3)
    deepest = places_mm[:, 2].max()
    near = points[points[:, 2] < deepest + _MARGIN_MM, :2]
    low = near.min(axis=0) - places_mm[:, :2].max(axis=0) - _MARGIN_MM
    high = near.max(axis=0) - places_mm[:, :2].min(axis=0) + _MARGIN_MM
    counts = np.ceil((high - low) / grid_mm).astype(int) + 1
    x, y = (np.linspace(*ends) for ends in zip(low, high, counts, strict=True))
    lowest = -deepest - _MARGIN_MM
    z = height_map(body, x, y, lowest)
    xyz = np.stack([*np.meshgrid(x, y, indexing="ij"), z], -1).reshape(-1, 3)
    index = np.arange(len(xyz)).reshape(z.shape)
    corners = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    cells = np.stack(corners, -1).reshape(-1, 4)
    cells = cells[np.all(xyz[cells, 2] > lowest, axis=1)]
    used, cells = np.unique(cells, return_inverse=True)
    return xyz[used], cells.reshape(-1, 4)


def _check_goes_to_places(protocol: Protocol) -> None:
    name = "force_N" if protocol.path is None else "path.force_N"
    for piece in protocol.pieces:
        force = getattr(piece, "force_N", None)
        if force is not None:
            raise StudyError(
                f"protocol.{name} is {force:g} but a deck knows no force: press to a depth_mm and "
                "hold the depth."
            )


def _check_only_moves(route: Route) -> None:
    for number, (_, motion) in enumerate(route.plan(), 1):
        if motion.held is not None:
            does = "holds loads: give it places"
        elif motion.turns_rad.any() or np.any(route.start_rad):
            does = "turns the stimulator: let it press, hold, slide and lift"
        else:
            continue
        raise StudyError(
            f"protocol.path: a deck knows places only, but piece {number} ({motion.phase}) {does}."
        )


def _element_faces(tets: NDArray[np.int64], triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return tetrahedron and face, 0 to 3 for S1 to S4, of each boundary triangle, (k, 2)."""
    corners = np.sort(tets[:, C3D10_FACES].reshape(-1, 3), axis=1)
    place = {tuple(face): i for i, face in enumerate(corners.tolist())}
    flat = [place[tuple(sorted(triangle))] for triangle in triangles.tolist()]
    return np.column_stack(np.divmod(np.array(flat, dtype=np.int64), 4))


def _finger_lines(
    finger: FingerMesh,
    deformable: NDArray[np.int64],
    used: NDArray[np.int64],
    held: NDArray[np.int64],
    present: list[str],
) -> list[str]:
    lines = ["*NODE, NSET=FINGER", *_rows(used, finger.nodes[used])]
    for name in present:
        own = deformable[finger.tissue[deformable] == TISSUES[name]]
        lines.append(f"*ELEMENT, TYPE=C3D10, ELSET={name.upper()}")
        lines += _rows(own, finger.cells[own][:, SOLID.vtk_order] + 1)
        lines.append(f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL={name.upper()}")
    return [*lines, "*NSET, NSET=HELD", *_listed(held + 1), "*BOUNDARY", "HELD, 1, 3"]


def _stimulator_lines(
    points: NDArray, squares: NDArray[np.int64], first_node: int, first_cell: int
) -> list[str]:
    """Return one layer of hexahedra; all nodes are prescribed, so its material has no effect."""
    count = len(points)
    below = points - [0.0, 0.0, _THICKNESS_MM]
    numbers = np.arange(first_node, first_node + 2 * count)
    above = squares + first_node + 1
    cells = np.arange(first_cell, first_cell + len(squares))
    return [
        "*NODE, NSET=STIMULATOR",
        *_rows(numbers, np.vstack([points, below])),
        "*ELEMENT, TYPE=C3D8, ELSET=BODY",
        *_rows(cells, np.hstack([above + count, above])),
        "*SOLID SECTION, ELSET=BODY, MATERIAL=BODY",
        "*MATERIAL, NAME=BODY",
        "*ELASTIC",
        "1.0, 0.0",
        "*SURFACE, NAME=MASTER, TYPE=ELEMENT",
        "BODY, S2",
    ]


def material_lines(name: str, constants: Material) -> list[str]:
    """Return the material of a tissue: its law."""
    return [f"*MATERIAL, NAME={name.upper()}", *_elastic_lines(constants)]


def _elastic_lines(c: Material) -> list[str]:
    if isinstance(c, Elastic):
        return ["*ELASTIC", _row(c.E_MPa, c.nu)]
    shear = c.C10_MPa, c.C01_MPa, c.C20_MPa, c.C11_MPa, c.C02_MPa
    if not (any(shear[1:]) or c.C30_MPa or c.D2_per_MPa):
        return ["*HYPERELASTIC, NEO HOOKE", _row(c.C10_MPa, c.D1_per_MPa)]
    volume = c.D1_per_MPa, c.D2_per_MPa or NO_D_PER_MPa
    if not c.C30_MPa:
        return ["*HYPERELASTIC, POLYNOMIAL, N=2", _row(*shear, *volume)]
    cubic = c.C30_MPa, 0.0, 0.0
    rows = [_row(*shear, *cubic), _row(0.0, *volume, NO_D_PER_MPa)]
    return ["*HYPERELASTIC, POLYNOMIAL, N=3", *rows]


def _contact_lines(faces: NDArray[np.int64], friction: float, penalty: Penalty) -> list[str]:
    return [
        "*SURFACE, NAME=SKIN, TYPE=ELEMENT",
        *(f"{tet + 1}, S{face + 1}" for tet, face in faces.tolist()),
        "*SURFACE INTERACTION, NAME=TOUCH",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        _row(penalty.stiffness_MPa_per_mm),
        *(["*FRICTION", _row(friction, penalty.stick_MPa_per_mm)] if friction else []),
        "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE",
        "SKIN, MASTER",
    ]


def _print_lines(energy: bool) -> list[str]:
    sets = ("STIMULATOR", "HELD")
    lines = [part for one in sets for part in (f"*NODE PRINT, NSET={one}, TOTALS=ONLY", "RF")]
    return [*lines, "*EL PRINT, ELSET=FELT", "ENER"] if energy else lines


def _step_lines(
    motion: Motion, start_mm: NDArray, longest_mm: tuple[float, float], printed: list[str]
) -> list[str]:
    """Write a step of equal increments for each straight part of a motion."""
    lines = []
    for before, after in pairwise(motion.places_mm):
        x, y, z = np.abs(after - before)
        count = math.ceil(max(np.hypot(x, y) / longest_mm[0], z / longest_mm[1]) - 1e-9)
        if count:
            lines += [
                f"** {motion.phase}: {np.linalg.norm(after - before):g} mm",
                "*STEP, NLGEOM, INC=10000",
                "*STATIC",
                _row(1.0 / count, 1.0, _SMALLEST_INCREMENT, 1.0 / count),
                "*BOUNDARY",
                *(
                    _row("STIMULATOR", k, k, u)
                    for k, u in enumerate((after - start_mm).tolist(), 1)
                ),
                *printed,
                "*END STEP",
            ]
    return lines


def _rows(numbers: NDArray[np.int64], values: NDArray) -> list[str]:
    """Return lines of a number, counted from 1, and its values."""
    pairs = zip((numbers + 1).tolist(), values.tolist(), strict=True)
    return [_row(number, *row) for number, row in pairs]


def _listed(numbers: NDArray[np.int64]) -> list[str]:
    return [_row(*line) for line in batched(numbers.tolist(), 16)]


def _row(*values: float | str) -> str:
    """Return one data line; CalculiX reads 20 characters of a number."""
    return ", ".join(f"{v:.12g}" if isinstance(v, float) else str(v) for v in values)
