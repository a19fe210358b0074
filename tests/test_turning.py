"""Bodies that turn: objectivity, torques of discs, and turns in a path."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import block_mesh
from dolfinx import fem
from materials import ONE_LAYER
from sphere_on_block import follow, sphere_on_block

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.path.rotations import matrix
from tactile_fem.simulation.pose import Pose
from tactile_fem.simulation.recorder import Recorder
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus.body import HalfSpace
from tactile_fem.study import Solver, Study
from tactile_fem.tissue.energies import shear_modulus

TURN = matrix([0.3, -0.2, 0.5])


def at_rest(problem: FingerProblem):
    """Return the load of a step without motion."""
    problem.begin_step(problem.state.translation_old.value.copy(), 0.01)
    return problem.load()


@pytest.mark.ranks
def test_a_block_turned_with_its_body_keeps_its_stress():
    problem = sphere_on_block()
    follow(problem, (0, 0, 0.3), (0, -0.1, 0.3))
    state, still = problem.state, at_rest(problem)
    x = state.u.function_space.tabulate_dof_coordinates()
    u = state.u.x.array.reshape(-1, 3)
    u[:] = (x + u) @ TURN.T - x
    problem.begin_step(TURN @ state.translation_old.value, 0.01, TURN)
    load = problem.load()
    np.testing.assert_allclose(load.force_N, TURN @ still.force_N, atol=1e-10)
    np.testing.assert_allclose(load.moment_Nmm, TURN @ still.moment_Nmm, atol=1e-10)
    assert abs(still.force_N[1]) > 0.05 * still.force_N[2] > 0
    assert load.stored_mJ == pytest.approx(still.stored_mJ, rel=1e-10)
    assert load.gap_error_mm == pytest.approx(still.gap_error_mm, rel=1e-8)
    assert abs(load.friction_mJ - still.friction_mJ) < 1e-12


@pytest.mark.ranks
def test_a_ball_that_twists_on_the_skin_slips_on_it():
    problem = sphere_on_block()
    pressed = follow(problem, (0, 0, 0.3), (0, 0, 0.3))
    for angle in (0.1, 0.2, 0.4):
        report = problem.solve(np.array([0.0, 0.0, 0.3]), 0.01, matrix([0.0, 0.0, angle]))
        assert report.converged
        twisted = problem.accept()
    assert twisted.force_N[2] == pytest.approx(pressed.force_N[2], rel=0.05)
    assert 0.03 < twisted.moment_Nmm[2] / twisted.force_N[2] < 0.3
    assert 0 < twisted.friction_mJ


@pytest.mark.parametrize(("degrees", "is_due"), [(4.0, False), (5.0, True)])
def test_a_twist_keeps_states_as_often_as_a_slide_5_mm_from_its_axis(degrees, is_due):
    """The default is 0.4 mm, 4.6 degrees."""
    trace = {"displacement_mm": np.zeros(2), "depth_mm": np.ones(2)}
    trace["stimulator_rad"] = np.radians([[0.0, 0.0, 0.0], [0.0, 0.0, degrees]])
    recorder = SimpleNamespace(
        _field_rows=[0],
        _trace=SimpleNamespace(at=lambda name, rows: trace[name][rows]),
        _simulation=SimpleNamespace(study=Study()),
    )
    step = SimpleNamespace(ends_piece=False, output=True)
    assert Recorder._is_due(recorder, step) == is_due


SIDE, HEIGHT, DEPTH = 4.0, 0.5, 0.01


def sheared_layer(friction: float) -> FingerProblem:
    """Return a plate below a layer that moves in its plane only, so that pressure is even."""
    line = np.linspace(-SIDE / 2, SIDE / 2, 9)
    comm = MPI.COMM_WORLD
    mesh = block_mesh(line, line, np.array([0.0, HEIGHT]), ["dermis"]) if comm.rank == 0 else None
    settings = Solver(held=("cut",), petsc={"snes_atol": 1e-12})

    def flat(V):
        Z = V.sub(2)
        dofs = fem.locate_dofs_geometrical((Z, Z.collapse()[0]), lambda x: x[2] > -1)
        zero = fem.Function(Z.collapse()[0])
        return [fem.dirichletbc(zero, dofs, Z)]

    domain = create_domain(mesh, comm, ("cut",))
    return FingerProblem(domain, ONE_LAYER, HalfSpace(), friction, settings, flat)


@pytest.mark.ranks
@pytest.mark.parametrize("friction", [50.0, 0.01])
def test_the_torque_of_a_disc_that_sticks_and_of_one_that_slips(friction):
    """A layer in simple shear, G J theta/h, and an even pressure that slips, mu p Int r dA."""
    problem = sheared_layer(friction)
    place, angle = np.array([0.3, -0.1, DEPTH]), 1e-4 if friction > 1 else 0.02
    problem.state.place(np.array([0.3, -0.1, 0.0]))
    pressed = follow(problem, place)
    about = np.array([0.1, 0.2, 0.0])  # so that its origin moves
    R = matrix([0.0, 0.0, angle])
    moved = about + R @ (place - about)
    assert problem.solve(moved, 0.01, R).converged
    load = problem.accept()
    torque = Pose(about, R).load(load.force_N, load.moment_Nmm)[3]
    if friction > 1:
        x, y = about[:2]
        J = SIDE**4 / 6 + SIDE**2 * (x**2 + y**2)
        expected = float(shear_modulus(ONE_LAYER.dermis)) * J * angle / HEIGHT
        assert load.work_mJ == pytest.approx(torque * angle / 2, rel=1e-6)
        assert abs(load.friction_mJ) < 1e-3 * load.work_mJ
    else:
        r = np.linspace(-SIDE / 2, SIDE / 2, 801)[:-1] + SIDE / 1600
        lever = np.hypot(*np.meshgrid(r - about[0], r - about[1])).mean()
        expected = friction * pressed.force_N[2] * lever
    gained = load.stored_mJ - pressed.stored_mJ
    assert load.work_mJ == pytest.approx(load.friction_mJ + gained, rel=1e-3)
    assert torque == pytest.approx(expected, rel=2e-3)
