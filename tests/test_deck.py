"""Decks for CalculiX: what is in them, and what CalculiX makes of them if it is there."""

from __future__ import annotations

import dataclasses
import re
import shutil
import subprocess

import numpy as np
import pytest
import ufl
from blocks import LAYERS, block_mesh
from materials import FULL, NEO_HOOKEAN, SECOND_ORDER, YEOH
from scripts import DEMOS, beside

from tactile_fem.errors import MeshError, StudyError
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.stimulus import KineticFriction
from tactile_fem.study import (
    Cylinder,
    Hold,
    Plate,
    Polynomial,
    Press,
    Protocol,
    Push,
    Solver,
    Sphere,
    Study,
    Text,
    Tissue,
    Twist,
)
from tactile_fem.tissue.energies import ORIGIN

with beside(DEMOS / "verification" / "deck.py"):
    from deck import Penalty, height_field, material_lines, write_deck

LINE = np.linspace(-3.0, 3.0, 4)
DEPTHS = np.array([0.0, 0.17, 0.82, 1.62, 3.0, 4.0])
BLOCK = block_mesh(LINE, LINE, DEPTHS, [*LAYERS, "bone"])
PRESS = Protocol(depth_mm=0.3, distance_mm=0.4)
PATH = PRESS.route(0.0)
STUDY = Study(stimulus=Plate(friction=0.3), protocol=PRESS)
# After Abaqus' manual, counted from 1: ends of the edges with nodes 5 to 10; corners of S1 to S4.
EDGES = np.array([[1, 2], [2, 3], [3, 1], [1, 4], [2, 4], [3, 4]]) - 1
FACES = np.array([[1, 2, 3], [1, 4, 2], [2, 4, 3], [3, 4, 1]]) - 1

needs_ccx = pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (ccx) is not installed")


class Deck:
    """A deck by its keyword lines: `blocks` of (keyword line, data lines)."""

    def __init__(self, path):
        self.text = path.read_text()
        self.blocks = []
        for line in self.text.splitlines():
            if line.startswith("**"):
                continue
            if line.startswith("*"):
                self.blocks.append((line, []))
            else:
                self.blocks[-1][1].append([field.strip() for field in line.split(",")])
        self.nodes = {}
        for rows in self.all("*NODE,"):
            self.nodes |= {int(row[0]): np.array(row[1:], dtype=float) for row in rows}

    def all(self, start):
        return [rows for line, rows in self.blocks if line.startswith(start)]

    def one(self, start):
        (rows,) = self.all(start)
        return rows

    def elements(self, start):
        return {int(row[0]): [int(n) for n in row[1:]] for rows in self.all(start) for row in rows}

    def points(self, numbers):
        return np.array([self.nodes[n] for n in numbers])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("deck") / "block.inp"
    size = write_deck(STUDY, BLOCK, path, press_step_mm=0.1, grid_mm=(0.5, 0.5))
    return size, Deck(path)


def test_tetrahedra_have_the_node_order_of_c3d10(written):
    deck = written[1]
    volume = 0.0
    for tet in deck.elements("*ELEMENT, TYPE=C3D10").values():
        x = deck.points(tet)
        np.testing.assert_allclose(x[4:], x[EDGES].mean(axis=1), atol=1e-9)
        volume += np.linalg.det(x[1:4] - x[0]) / 6
        assert np.linalg.det(x[1:4] - x[0]) > 0
    assert volume == pytest.approx(36.0 * 3.0)


def test_each_tissue_has_its_elements_and_material(written):
    deck = written[1]
    for name in LAYERS:
        numbers = deck.elements(f"*ELEMENT, TYPE=C3D10, ELSET={name.upper()}")
        tags = BLOCK.tissue[np.array(list(numbers)) - 1]
        assert len(numbers) == 54
        assert set(tags) == {TISSUES[name]}
        assert f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL={name.upper()}\n" in deck.text
        assert f"*MATERIAL, NAME={name.upper()}\n" in deck.text
    assert "BONE" not in deck.text


def test_nodes_that_held_bone_shares_are_fixed(written):
    size, deck = written
    held = [int(n) for row in deck.one("*NSET, NSET=HELD") for n in row]
    assert len(held) == 7 * 7
    assert set(deck.points(held)[:, 2]) == {3.0}
    assert ["HELD", "1", "3"] in deck.all("*BOUNDARY")[0]
    assert size.unknowns == 3 * (len(deck.one("*NODE, NSET=FINGER")) - 49)


def test_bone_that_is_not_held_is_elastic(tmp_path):
    study = STUDY.model_copy(update={"solver": Solver(held=("cut",))})
    size = write_deck(study, BLOCK, tmp_path / "soft.inp", grid_mm=(1.0, 1.0))
    deck = Deck(tmp_path / "soft.inp")
    assert size.cells == len(BLOCK.cells)
    assert deck.text.count("*ELASTIC\n17000, 0.3") == 1
    held = [int(n) for row in deck.one("*NSET, NSET=HELD") for n in row]
    assert set(deck.points(held)[:, 2]) == {4.0}


def test_slave_faces_are_the_skin(written):
    size, deck = written
    tets = deck.elements("*ELEMENT, TYPE=C3D10")
    area = np.zeros(3)
    faces = deck.one("*SURFACE, NAME=SKIN")
    for number, face in faces:
        a, b, c = deck.points(np.array(tets[int(number)])[FACES[int(face[1]) - 1]])
        assert np.all([a[2], b[2], c[2]] == np.zeros(3))
        area += np.abs(np.cross(b - a, c - a)) / 2
    np.testing.assert_allclose(area, [0, 0, 36.0], atol=1e-9)
    assert len(faces) == size.skin_facets == 18


def driven(*ends):
    return [["STIMULATOR", k, k, end] for k, end in zip("123", ends, strict=True)]


def test_stimulator_is_driven_and_covers_press_and_slide(written):
    _, deck = written
    body = deck.elements("*ELEMENT, TYPE=C3D8")
    top = np.unique([cell[4:] for cell in body.values()])
    x = deck.points(top)
    assert np.all(x[:, 2] == pytest.approx(0.0, abs=1e-3))
    assert np.all(x.min(axis=0)[:2] <= -3.0)
    assert x[:, 0].max() >= 3.0
    assert x[:, 1].max() >= 3.4
    for cell in body.values():
        edges = deck.points([cell[1], cell[3], cell[4]]) - deck.nodes[cell[0]]
        assert np.linalg.det(edges) > 0
    assert deck.one("*SURFACE, NAME=MASTER") == [["BODY", "S2"]]
    _, press, slide = deck.all("*BOUNDARY")
    assert press == driven("0", "0", "0.3")
    assert slide == driven("0", "-0.4", "0.3")


def test_increments_are_those_asked_for(written):
    press, slide = (rows[0] for rows in written[1].all("*STATIC"))
    assert float(press[0]) == float(press[3]) == pytest.approx(1 / 3)
    assert float(slide[0]) == float(slide[3]) == pytest.approx(0.5)


def test_contact_law(written):
    deck = written[1]
    ((stiffness,),) = deck.one("*SURFACE BEHAVIOR")
    ((friction, stick),) = deck.one("*FRICTION")
    # gamma (K + 4 G/3)/h with gamma 1.2, K 1.479 and G 0.0600 MPa, h 0.17 mm
    assert float(stiffness) == pytest.approx(11.01, rel=0.01)
    assert float(stick) == pytest.approx(1.101, rel=0.01)
    assert friction == "0.3"
    assert deck.one("*CONTACT PAIR") == [["SKIN", "MASTER"]]


def test_fields_are_as_short_as_calculix_reads_them(written):
    for line, rows in written[1].blocks:
        if line.startswith("*NODE,"):
            assert max(len(field) for row in rows for field in row) < 20


def test_energy_of_chosen_tetrahedra_is_printed_in_both_steps(tmp_path):
    way = {"grid_mm": (1.0, 1.0), "energy_of": np.array([0, 7])}
    write_deck(STUDY, BLOCK, tmp_path / "felt.inp", **way)
    deck = Deck(tmp_path / "felt.inp")
    assert deck.one("*ELSET, ELSET=FELT") == [["1", "8"]]
    assert deck.all("*EL PRINT, ELSET=FELT") == [[["ENER"]], [["ENER"]]]


def test_no_step_without_a_slide(tmp_path):
    study = Study(stimulus=Plate(friction=0.0), protocol=Protocol(depth_mm=0.3, distance_mm=0.0))
    write_deck(study, BLOCK, tmp_path / "press.inp", grid_mm=(1.0, 1.0))
    deck = Deck(tmp_path / "press.inp")
    assert len(deck.all("*STEP")) == 1
    assert not deck.all("*FRICTION")


@pytest.mark.parametrize("stimulus", [Text(), Cylinder()])
def test_height_field_lies_on_the_body(stimulus):
    body = stimulus.body()
    skin = BLOCK.nodes[BLOCK.nodes[:, 2] == 0]
    points, squares = height_field(body, PATH.places_mm(), skin, (0.25, 0.25))
    assert np.abs(body.distance(points).gap).max() < 2e-3
    assert points[:, 2].min() > -0.3 - 0.6
    a, b, c, d = (points[squares[:, i]] for i in range(4))
    assert np.all(np.cross(c - a, d - b)[:, 2] > 0)


def test_contact_is_as_stiff_as_the_meshs_own_stratum_corneum_asks_for():
    thick = dataclasses.replace(BLOCK, nodes=2.0 * BLOCK.nodes)
    stiffness = [Penalty.of(STUDY, mesh).stiffness_MPa_per_mm for mesh in (BLOCK, thick)]
    skin = STUDY.tissue.stratum_corneum
    K, G = 2 / skin.D1_per_MPa, 2 * skin.C10_MPa
    assert stiffness[0] == pytest.approx(1.2 * (K + 4 / 3 * G) / 0.17)
    assert stiffness[1] == pytest.approx(stiffness[0] / 2)
    with pytest.raises(MeshError, match="no stratum corneum"):
        Penalty.of(STUDY, dataclasses.replace(BLOCK, nodes=BLOCK.nodes + np.array([0, 0, 20.0])))


PRESSED, KINETIC = Press(depth_mm=0.3), KineticFriction(static=0.6, kinetic=0.2, speed_mm_s=8.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"protocol": Protocol(force_N=0.5)}, r"protocol\.force_N is 0\.5 but .* to a depth_mm"),
        (
            {"protocol": Protocol(path=(Hold(time_s=1.0, force_N=0.5),))},
            r"protocol\.path\.force_N is 0\.5",
        ),
        (
            {"protocol": Protocol(path=(PRESSED, Twist(angle_deg=5.0)))},
            r"a deck knows places only, but piece 2 \(twist\) turns the stimulator: let it press",
        ),
        (
            {"protocol": Protocol(path=(PRESSED, Push(time_s=1.0, tangential_N=(0.1, 0.0))))},
            r"a deck knows places only, but piece 2 \(push\) holds loads: give it",
        ),
        ({"solver": Solver(held=("nail",))}, "nothing of the mesh is held"),
        (
            {"stimulus": Sphere(shift_mm=(60, 0))},
            r"57 mm .*; a deck needs contact: correct stimulus",
        ),
        (
            {"stimulus": Plate(friction=KINETIC)},
            r'law = "kinetic" is not written into a deck: give a num',
        ),
        (
            {"tissue": Tissue.model_validate({"dermis": {"g": (0.3,), "tau_s": (0.07,)}})},
            r"tissue\.dermis\.g is set but CalculiX",
        ),
    ],
)
def test_what_a_deck_cannot_hold_is_refused(tmp_path, changes, words):
    with pytest.raises(StudyError, match=words):
        write_deck(STUDY.model_copy(update=changes), BLOCK, tmp_path / "no.inp")
    assert not list(tmp_path.iterdir())


# --- CalculiX ------------------------------------------------------------------------------------


def run_ccx(folder, name):
    command = ["ccx", "-i", name]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert "Job finished" in done.stdout, done.stdout[-2000:]
    return (folder / f"{name}.dat").read_text()


STRETCH = np.diag([1.3, 0.85, 0.85])
SHEAR = np.array([[1.0, 0.4, 0.1], [0.0, 0.9, 0.2], [0.1, 0.0, 1.1]])


def energy_of(constants: Polynomial, F: np.ndarray) -> float:
    return float(constants.energy(ufl.as_matrix(F.tolist()), ORIGIN)(()))


def piola(constants: Polynomial, F: np.ndarray) -> np.ndarray:
    """Return the first Piola stress by central differences of our energy."""
    h = 1e-5
    P = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = h
            P[i, j] = (energy_of(constants, F + step) - energy_of(constants, F - step)) / (2 * h)
    return P


@needs_ccx
@pytest.mark.parametrize("constants", [NEO_HOOKEAN, SECOND_ORDER, YEOH, FULL])
@pytest.mark.parametrize("F", [STRETCH, SHEAR], ids=["stretch", "shear"])
def test_calculix_has_our_energy(constants, F, tmp_path):
    """One tetrahedron deformed by `F`: its middle nodes carry P V (grad l_a + grad l_b).

    Its energy per undeformed volume is summed up by the trapezoidal rule, so in many increments.
    """
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    nodes = np.vstack([corners, corners[EDGES].mean(axis=1)])
    moved = nodes @ (F - np.eye(3)).T
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n}, {x:.9g}, {y:.9g}, {z:.9g}" for n, (x, y, z) in enumerate(nodes, 1)]
    lines += ["*ELEMENT, TYPE=C3D10, ELSET=TET", ", ".join(map(str, [1, *range(1, 11)]))]
    lines += ["*SOLID SECTION, ELSET=TET, MATERIAL=SOFT", *material_lines("soft", constants)]
    lines += ["*STEP, NLGEOM", "*STATIC", "0.02, 1., 1e-5, 0.02", "*BOUNDARY"]
    lines += [
        f"{n}, {axis}, {axis}, {value:.9g}"
        for n, row in enumerate(moved, 1)
        for axis, value in enumerate(row, 1)
    ]
    lines += ["*NODE PRINT, NSET=ALL", "RF", "*EL PRINT, ELSET=TET", "ENER", "*END STEP", ""]
    (tmp_path / "tet.inp").write_text("\n".join(lines))
    printed = run_ccx(tmp_path, "tet")
    rows = re.findall(r"^ +\d+((?: +-?[\d.]+E[+-]\d+){3})", printed, re.M)[-10:]
    found = np.array([row.split() for row in rows], dtype=float)
    energy = float(re.findall(r"^ +1 +4 +(\S+)$", printed, re.M)[-1])
    assert energy == pytest.approx(energy_of(constants, F), rel=5e-4)
    gradients = np.array([[-1, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    forces = gradients[EDGES].sum(axis=1) @ piola(constants, F).T / 6
    np.testing.assert_allclose(found[:4], 0.0, atol=1e-9)
    np.testing.assert_allclose(found[4:], forces, atol=2e-6 * np.abs(forces).max())


@needs_ccx
@pytest.mark.slow
def test_calculix_presses_and_slides_a_block_as_we_do(tmp_path):
    from tactile_fem.runtime import backend  # noqa: F401

    from mpi4py import MPI  # isort: skip

    from tactile_fem.mechanics.domain import create_domain
    from tactile_fem.solvers.finger_problem import FingerProblem

    elastic = Tissue.model_validate({"viscous_time_s": 0.0})
    # CalculiX integrates volume change at every point.
    study = STUDY.model_copy(update={"tissue": elastic, "solver": Solver(locking_ratio=1e9)})
    write_deck(study, BLOCK, tmp_path / "block.inp", press_step_mm=0.1, grid_mm=(2.0, 2.0))
    printed = run_ccx(tmp_path, "block")
    totals = r"total force .* set {} .*\s+([-+.\dE]+)\s+([-+.\dE]+)\s+([-+.\dE]+)"
    theirs = np.array(re.findall(totals.format("STIMULATOR"), printed), dtype=float)
    held = np.array(re.findall(totals.format("HELD"), printed), dtype=float)
    np.testing.assert_allclose(theirs, -held, atol=1e-5)

    domain = create_domain(BLOCK, MPI.COMM_SELF, study.solver.held)
    body = study.stimulus.body()
    problem = FingerProblem(domain, elastic, body, study.stimulus.friction, study.solver)
    ways = [(0, 0, 0.1), (0, 0, 0.2), (0, 0, 0.3), (0, -0.2, 0.3), (0, -0.4, 0.3)]
    ours = []
    for place in ways:
        assert problem.solve(np.array(place, dtype=float), 0.01).converged
        ours.append(problem.accept().force_N)
    assert len(theirs) == len(ours)
    np.testing.assert_allclose(theirs, ours, atol=0.03 * ours[-1][2])
