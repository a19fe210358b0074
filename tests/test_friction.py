"""Laws of friction on a block: closed forms in full slip, tangents, restarts and sentences."""

from __future__ import annotations

from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import block_mesh
from dolfinx import fem
from materials import ELASTIC
from needs import needs_gmsh
from sphere_on_block import DEPTHS, TWO_TISSUES, follow

from tactile_fem import Simulation
from tactile_fem.errors import StudyError
from tactile_fem.mechanics.domain import create_domain, roller
from tactile_fem.path.rotations import matrix
from tactile_fem.simulation.checks import check
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus import Friction, KineticFriction, MappedFriction, PressureFriction
from tactile_fem.study import Drawing, Finger, Plate, Solver, Sphere, Study, Surface, Text
from tactile_fem.study.file import load_study
from tactile_fem.study.input_copies import INPUTS, keep_files
from tactile_fem.vibration.harmonic import Harmonic

STATIC, KINETIC, SPEED_MM_S = 0.6, 0.2, 8.0
EXPONENT, PRESSURE_MPA = 0.8, 0.002
LOW, HIGH = 0.2, 0.6  # of the map, at Y of -2 mm and less and of 2 mm and more
HALF_MM = 0.5
DT_S = 0.01
SMALL = Path(__file__).parents[1] / "meshes" / "small.npz"


@pytest.fixture(scope="module")
def laws(tmp_path_factory):
    """Return a law of each kind."""
    folder = MPI.COMM_WORLD.bcast(tmp_path_factory.mktemp("friction"))
    file = folder / "map.csv"
    if MPI.COMM_WORLD.rank == 0:
        np.savetxt(file, np.tile([LOW, LOW, HIGH, HIGH], (4, 1)), delimiter=",")
    MPI.COMM_WORLD.barrier()
    return {
        "kinetic": KineticFriction(static=STATIC, kinetic=KINETIC, speed_mm_s=SPEED_MM_S),
        "pressure": PressureFriction(
            coefficient=0.5, pressure_MPa=PRESSURE_MPA, load_index=EXPONENT
        ),
        "map": MappedFriction(file=file, spacing_mm=4.0),
    }


@cache
def block():
    line = np.array([-HALF_MM, HALF_MM])
    return create_domain(block_mesh(line, line, DEPTHS, TWO_TISSUES), MPI.COMM_WORLD, ("cut",))


def problem(friction, *, tissue=ELASTIC, body=None, upright=True, **more):
    """Return a plate below a block, of which nothing may move sideways if it is `upright`."""

    def upright_only(V):
        everywhere = [lambda x: np.full(x.shape[1], True)] * 2 if upright else []
        return [roller(V, axis, where) for axis, where in enumerate(everywhere)]

    settings = Solver(held=("cut",), linear="direct", petsc={"snes_atol": 1e-11}, **more)
    body = body or Plate().body()
    return FingerProblem(block(), tissue, body, friction, settings, upright_only)


def drag(contact, *places_mm, dt_s=DT_S):
    """Return tangential and normal force once the plate has gone along Y to each of the places."""
    return [follow(contact, (0, y, 0.3), dt_s=dt_s).force_N[1:] for y in places_mm]


def pressed(friction, y=0.0):
    contact = problem(friction)
    for depth in (0.1, 0.2, 0.3):
        follow(contact, (0, y, depth))
    return contact


@pytest.mark.ranks
@pytest.mark.parametrize("speed", [2.0, 10.0])
def test_kinetic_friction_follows_the_slip_speed(laws, speed):
    contact = pressed(laws["kinetic"])
    *_, (tangential, normal) = drag(contact, -0.1, -0.2, -0.3, dt_s=0.1 / speed)
    expected = KINETIC + (STATIC - KINETIC) * np.exp(-speed / SPEED_MM_S)
    assert -tangential / normal == pytest.approx(expected, rel=1e-7)


@pytest.mark.ranks
def test_friction_grows_with_a_power_of_the_pressure(laws):
    contact, area = pressed(laws["pressure"]), 4 * HALF_MM**2
    *_, (tangential, normal) = drag(contact, -0.1, -0.2)
    pressure = normal / area
    assert pressure > PRESSURE_MPA
    expected = 0.5 * PRESSURE_MPA * (pressure / PRESSURE_MPA) ** EXPONENT * area
    assert -tangential == pytest.approx(expected, rel=1e-4)


@pytest.mark.ranks
def test_a_map_holds_in_the_frame_of_the_body(laws):
    contact = pressed(laws["map"], y=4.0)  # the finger is over Y = -4 of the body
    found = drag(contact, 3.9, 3.0, 0.0, -3.0, -4.0)
    ratios = [-tangential / normal for tangential, normal in found]
    np.testing.assert_allclose(ratios[1:], [LOW, (LOW + HIGH) / 2, HIGH, HIGH], rtol=1e-7)


@pytest.mark.ranks
def test_a_map_turns_with_its_body(laws):
    contact = problem(laws["map"])
    half_turn = matrix([0, 0, np.pi])
    assert contact.solve(np.array([0, 4.0, -0.5]), DT_S, half_turn).converged
    contact.accept()
    follow(contact, *((0, 4.0, depth) for depth in (0.1, 0.2, 0.3)))
    (tangential, normal), *_ = drag(contact, 3.9)
    assert -tangential / normal == pytest.approx(HIGH, rel=1e-7)


@pytest.mark.ranks
@pytest.mark.parametrize("law", ["kinetic", "pressure"])
def test_skin_that_slides_follows_a_vibration_of_the_pressure(laws, law):
    contact = pressed(laws[law])
    *_, (tangential, normal) = drag(contact, -0.1, -0.2)
    _, along, across = Harmonic(contact, 1e-6).respond(1.0, [0, 0, 1.0]).force_N
    expected = tangential / normal * (EXPONENT if law == "pressure" else 1)
    assert along / across == pytest.approx(expected, rel=1e-4)


@pytest.mark.ranks
@pytest.mark.parametrize("law", ["kinetic", "pressure", "map"])
def test_the_tangent_is_the_derivative_of_the_residual(laws, law):
    ball = Sphere(radius_mm=4.0).body()
    contact = problem(laws[law], body=ball, upright=False, tangent_iterations=1)
    contact.state.place((0, 0, 0.1))
    contact.begin_step(np.array([0, -0.1, 0.1]), DT_S, matrix([0, 0, 0.5]))
    snes, random = contact.solver.snes, np.random.default_rng(0)

    def vector(scale):
        values = scale * random.normal(size=contact.domain.nodes.shape)
        values[contact.domain.held] = 0.0
        u = fem.Function(contact.u.function_space)
        contact.order.scatter(values, u)
        found = snes.getFunction()[0].duplicate()
        found.array = u.x.array[: found.getLocalSize()]
        return found

    x, direction = vector(1e-3), vector(1.0)
    A, product = snes.getJacobian()[0], x.duplicate()
    snes.computeJacobian(x, A)
    A.mult(direction, product)
    results, eps = [x.duplicate(), x.duplicate()], 1e-8
    for sign, result in zip((1, -1), results, strict=True):
        there = x.duplicate()
        there.waxpy(sign * eps, direction, x)
        snes.computeFunction(there, result)
    error = (results[0] - results[1]) / (2 * eps) - product
    assert error.norm() < 1e-6 * product.norm()


@pytest.mark.ranks
@pytest.mark.parametrize("law", ["kinetic", "pressure", "map"])
def test_a_restart_midway_takes_the_same_steps(laws, law):
    contact = pressed(laws[law], y=1.0)
    drag(contact, 0.9)
    held = contact.gather()
    on, again = contact, problem(laws[law])
    again.restore(held)
    np.testing.assert_allclose(drag(again, 0.5, 0.2), drag(on, 0.5, 0.2), rtol=1e-12)


def test_a_script_may_state_a_law_of_its_own(monkeypatch):
    """It joins the study, and the results of a scan with it are read without the script."""
    monkeypatch.setattr(Friction, "kinds", dict(Friction.kinds))

    class Falling(Friction):
        law: Literal["falling"] = "falling"
        coefficient: float

        def coefficient_at(self, pressure, speed, local):
            return self.coefficient / (1 + speed)

    study = load_study(None, ["stimulus.friction={law='falling', coefficient=0.8}"])
    contact = pressed(study.stimulus.law())
    *_, (tangential, normal) = drag(contact, -0.1, -0.2)
    assert -tangential / normal == pytest.approx(0.8 / (1 + 0.1 / DT_S), rel=1e-7)
    del Friction.kinds["falling"]
    saved = Study.model_validate(study.model_dump(), context={"saved": True})
    assert saved.model_dump() == study.model_dump()
    assert saved.stimulus.law().uniform is None


def at(stimulus, x, y) -> tuple[float, list[float]]:
    """Return the coefficient and its gradient at a place of the body."""
    values, gradients = stimulus.law().over_body()(np.array([[x, y, 0.0]]))
    return float(values[0]), gradients[0].tolist()


def test_a_map_turns_with_its_body_as_a_study_turns_it(laws, tmp_path):
    """It grows along Y: after a quarter of a turn along -X."""
    np.save(tmp_path / "z.npy", np.zeros((9, 9)))
    slope = (HIGH - LOW) / 4
    law = laws["map"]
    keys = {"file": tmp_path / "z.npy", "spacing_mm": 1.0, "unit_mm": 1.0, "friction": law}
    for shift in ((0.0, 0.0), (1.0, 2.0)):
        surface = Surface(**keys, turn_deg=90.0, shift_mm=shift)
        value, gradient = at(surface, shift[0] - 1.0, shift[1])
        assert value == pytest.approx((LOW + HIGH) / 2 + slope)
        assert gradient == pytest.approx([-slope, 0, 0], abs=1e-12)
    square = [(-2, -2), (2, -2), (2, 2), (-2, 2)]
    drawing = Drawing(polygons=[square], turn_deg=90.0, start_mm=3.0, friction=law)
    # The map's middle turns about that of the drawing, which lies at Y = -3, to X = Y = -3.
    assert at(drawing, -4.0, -3.0)[0] == pytest.approx((LOW + HIGH) / 2 + slope)
    own = law.model_copy(update={"turn_deg": 180.0})
    assert at(Plate(friction=own), 0.0, -1.0)[0] == pytest.approx((LOW + HIGH) / 2 + slope)
    turned = Surface(**keys, turn_deg=45.0).law()
    with pytest.raises(StudyError, match=r"covers X -[0-9.]+ to [0-9.]+, Y .* give a larger map"):
        turned.check_covers(*(side * turned.coefficients().half_mm for side in (-1, 1)))
    turned.check_covers(np.array([-1.0, -1.0]), np.array([1.0, 1.0]))


@pytest.mark.parametrize("stimulus", [Text(text="G"), Plate()])
def test_a_folder_keeps_the_map_of_any_stimulus(stimulus, laws, tmp_path):
    own = tmp_path / "own.csv"
    own.write_bytes(laws["map"].file.read_bytes())
    law = laws["map"].model_copy(update={"file": own})
    study = Study(stimulus=stimulus.model_copy(update={"friction": law}))
    assert study.files()["stimulus.friction.file"] == own
    keep_files(study, tmp_path, afresh=True)
    (kept,) = (tmp_path / INPUTS).glob("own-*.csv")
    assert kept.read_bytes() == own.read_bytes()


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        (
            "0.1,0.2\n0.3,-1\n",
            "has 1 missing or negative coefficients, the first in row 1, column 1",
        ),
        ("0.1,0.2\n0.3,\n", "has 1 missing or negative coefficients, the first in row 1, column 1"),
        ("0.1,0.2\n0.3,0.4\n", "covers X -2 to 2, Y -2 to 2 mm of the body, but the finger may"),
    ],
)
def test_a_map_that_does_not_do_is_refused(tmp_path, rows, sentence):
    file = tmp_path / "map.csv"
    file.write_text(rows)
    law = MappedFriction(file=file, spacing_mm=4.0)
    study = Study(stimulus=Plate(friction=law), finger=Finger(mesh_file=SMALL))
    with pytest.raises(StudyError, match=f"stimulus.friction.file = .*{sentence}"):
        check(study)


@needs_gmsh
def test_viscosity_steadies_friction_that_falls_with_speed():
    """Without it this slide ends where skin jumps from sticking to sliding."""
    study = load_study(
        None,
        [
            *("finger.kind=section", "stimulus.kind=plate", "tissue.viscous_time_s=0.2"),
            *("protocol.depth_mm=0.5", "protocol.distance_mm=2.5", "protocol.speed_mm_s=1"),
            "stimulus.friction={law='kinetic', static=0.5, kinetic=0.3, speed_mm_s=2}",
        ],
    )
    with closing(Simulation(study)) as simulation:
        forces = [step.load.force_N for step in simulation.steps() if not step.indenting]
    ratio = [-force[1] / force[2] for force in forces]
    slides = 0.3 + 0.2 * np.exp(-1 / 2)
    assert max(ratio) > 1.1 * slides
    assert ratio[-1] == pytest.approx(slides, rel=1e-3)
