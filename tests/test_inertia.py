"""Inertia in time: exact waves, the harmonic response, and a history that is kept."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import LAYERS, block_mesh
from materials import NO_VISCOSITY_S, relaxing, uniform
from sphere_on_block import TWO_TISSUES, follow, sphere_on_block

from tactile_fem.mechanics.domain import create_domain, roller
from tactile_fem.mechanics.state import PointHistory
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Plate, Solver
from tactile_fem.vibration.harmonic import Harmonic

C10, D1, HEIGHT, DENSITY = 0.01, 20.0, 2.0, 1000.0
MODULUS = 2 / D1 + 4 / 3 * 2 * C10
WAVE_MM_S = np.sqrt(MODULUS / (DENSITY * 1e-12))
PERIOD_S = 3 * HEIGHT / WAVE_MM_S
DEPTH_MM, AMPLITUDE_MM = 1e-4, 1e-5


def column(layers: int = 12) -> FingerProblem:
    """Return an elastic column between smooth walls, on a plate, held at its other end."""
    line, depths = np.array([-0.5, 0.5]), np.linspace(0, HEIGHT, layers + 1)
    names = [LAYERS[4 * k // layers] for k in range(layers)]
    domain = create_domain(block_mesh(line, line, depths, names), MPI.COMM_WORLD, ("cut",))
    settings = Solver(
        inertia=True,
        held=("cut",),
        linear="direct",
        petsc={"snes_atol": 1e-13},
        contact_width_MPa=1e-8,
    )

    def sides(axis: int):
        return lambda x: np.isclose(abs(x[axis]), 0.5)

    return FingerProblem(
        domain,
        uniform(C10, D1, density_kg_m3=DENSITY),
        Plate().body(),
        0.0,
        settings,
        lambda V: [roller(V, axis, sides(axis)) for axis in (0, 1)],
    )


def wave(t: np.ndarray) -> np.ndarray:
    """Return how far the plate has gone at times since it began to move, mm."""
    moved = AMPLITUDE_MM * (1 - np.cos(2 * np.pi * t / PERIOD_S)) ** 2 / 4
    return np.where(t > 0, moved, 0.0)


def slope(t: np.ndarray) -> np.ndarray:
    """Return the velocity of the plate, mm/s."""
    w = 2 * np.pi / PERIOD_S
    return np.where(t > 0, AMPLITUDE_MM * w * (1 - np.cos(w * t)) * np.sin(w * t) / 2, 0.0)


def echoes(of, z: np.ndarray, t: float, sign: int) -> np.ndarray:
    """Return the sum of d'Alembert's waves away from the plate and, times `sign`, back to it."""
    up = sum(of(t - (2 * k * HEIGHT + z) / WAVE_MM_S) for k in range(4))
    return up + sign * sum(of(t - (2 * k * HEIGHT - z) / WAVE_MM_S) for k in range(1, 4))


def wave_errors(shares: list[float]) -> np.ndarray:
    """Follow a wave in steps, given as shares of its period; return errors of u, mm, and F, N."""
    problem = column()
    still, u = follow(problem, (0, 0, DEPTH_MM), dt_s=1e3).force_N[2], problem.u.x.array.copy()
    z = problem.u.function_space.tabulate_dof_coordinates()[:, 2]
    t, errors = 0.0, np.zeros(2)
    for step_s in PERIOD_S * np.array(shares):
        t += step_s
        load = follow(problem, (0, 0, DEPTH_MM + wave(t)), dt_s=step_s)
        assert load.imbalance_N < 1e-8
        moved = (problem.u.x.array - u)[2::3] - echoes(wave, z, t, -1)
        force = MODULUS / WAVE_MM_S * echoes(slope, np.zeros(1), t, 1)[0]
        here = np.abs(moved).max(initial=0.0), abs(load.force_N[2] - still - force)
        errors = np.maximum(errors, here)
    return np.max(problem.domain.comm.allgather(errors), axis=0)


@pytest.mark.ranks
def test_waves_in_a_column_are_exact_to_the_second_order_of_the_step():
    """Also where steps are shorter than waves take through an element, 0.4 times at the end."""
    coarse, fine = (wave_errors(n * [1 / n]) for n in (48, 96))
    largest = np.array([AMPLITUDE_MM, MODULUS / WAVE_MM_S * slope(np.array(PERIOD_S / 3))])
    assert (fine < [0.007 * largest[0], 0.02 * largest[1]]).all()
    assert (coarse > 3.5 * fine).all()


def test_steps_may_be_cut():
    whole, cut = (wave_errors(shares) for shares in (48 * [1 / 48], 24 * [1 / 48, 1 / 96, 1 / 96]))
    assert (cut < whole).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "friction", "frequency"),
    [(2, 0.0, 100.0), (0, 0.5, 30.0)],
)
def test_a_body_that_vibrates_in_time_gives_the_harmonic_response(axis, friction, frequency):
    made = relaxing(g=(0.2, 0.2), tau_s=(0.01, 0.004), viscous_time_s=NO_VISCOSITY_S)
    problem = sphere_on_block(made, layers=TWO_TISSUES, inertia=True)

    def force(place: np.ndarray, step_s: float) -> float:
        load = follow(problem, place, dt_s=step_s)
        assert load.imbalance_N < 1e-9
        return load.force_N[axis]

    place, along = np.array([0.0, 0.0, 0.3]), np.eye(3)[axis]
    for value, shares in ((0.0, np.linspace(0, 1, 7)[1:]), (friction, 6 * [1.0])):
        problem.contact.friction.coefficient.value = (
            value  # 0 at first: all of the skin then sticks
        )
        for share in shares:
            force(share * place, 0.01)
    held, found, steps = problem.gather(), [], 24
    phases = 2 * np.pi * np.arange(1, 3 * steps + 1) / steps
    for amplitude in (1e-4, -1e-4):  # their difference does not drift
        problem.restore(held)
        swings = amplitude * np.sin(phases)
        forces = [force(place + by * along, 1 / frequency / steps) for by in swings]
        found.append(2j / steps * (np.exp(-1j * phases) * forces)[-steps:].sum() / amplitude)
    problem.restore(held)
    exact, massless = (
        Harmonic(problem, density).respond(frequency, along).force_N[axis]
        for density in (DENSITY, 1e-6)
    )
    assert abs(massless / exact) > 1.1  # mass counts
    np.testing.assert_allclose(np.mean(found), exact, rtol=0.02)


def motion_of(problem: FingerProblem) -> PointHistory:
    return next(history for history in problem.state.histories if history.name == "motion")


def go(problem: FingerProblem, steps: range) -> list[np.ndarray]:
    """Press in steps of growing length; return the forces."""
    forces = []
    for k in steps:
        load = follow(problem, (0.0, 0.01 * k, 0.04 * k), dt_s=1e-4 * (1 + k))
        assert load.imbalance_N < 1e-9
        forces.append(load.force_N)
    return forces


@pytest.mark.ranks
def test_motion_is_kept_restored_and_the_same_on_all_ranks():
    whole = sphere_on_block(inertia=True)
    first = go(whole, range(1, 4))
    saved = whole.gather()
    u, motion = whole.u.x.array.copy(), motion_of(whole).old.x.array.copy()
    assert np.abs(motion).max(initial=0.0) > 0
    whole.solve(np.array([0.0, 0.0, 0.3]), 1e-4)  # a step that is not accepted
    whole.state.reset()
    np.testing.assert_array_equal(whole.u.x.array, u)
    rest = go(whole, range(4, 6))
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        again = sphere_on_block(comm=comm, inertia=True)
        again.restore(MPI.COMM_WORLD.bcast(saved))
        np.testing.assert_allclose(go(again, range(4, 6)), rest, atol=1e-9)
    alone = sphere_on_block(comm=MPI.COMM_SELF, inertia=True)
    np.testing.assert_allclose(go(alone, range(1, 6)), first + rest, atol=1e-9)


def test_without_inertia_there_is_no_motion():
    assert not any("motion" in name for name in sphere_on_block().gather())
