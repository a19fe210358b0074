"""A block with sharp edges pressed by a tenth and slid: what gamma changes."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import block_mesh
from sphere_on_block import follow

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Plate, Solver, Tissue

TISSUE = Tissue.model_validate({"set": "maeno1998"})
PLATE = Plate(friction=0.3)


def forces(count: int, gamma: float, slides=(), **choice) -> np.ndarray:
    """Return the forces after the press and after each slide, with `count` bricks over 3 mm."""
    line, up = np.linspace(-3, 3, 2 * count + 1), np.linspace(0, 3, count + 1)
    block = block_mesh(line, line, up, ["dermis"] * count)
    solver = Solver(held=("cut",), linear="direct", nitsche_gamma=gamma, **choice)
    domain = create_domain(block, MPI.COMM_WORLD, solver.held)
    problem = FingerProblem(domain, TISSUE, PLATE.body(), PLATE.friction, solver)
    follow(problem, (0, 0, 0.1), (0, 0, 0.2))
    return np.array([follow(problem, (0, -y, 0.3)).force_N for y in (0.0, *slides)])


def test_what_gamma_changes_is_small_and_goes_with_the_mesh():
    differences = []
    for count in (2, 3):
        default, stiff = (forces(count, g)[0, 2] for g in (Solver().nitsche_gamma, 12.0))
        differences.append(abs(default / stiff - 1))
    assert differences[1] < 0.02
    assert differences[1] < differences[0]


@pytest.mark.slow
def test_every_theta_gives_the_same_force():
    """With a gamma that is large enough for all three; not optimized, which would take minutes."""
    incomplete, *others = (
        forces(2, 40.0, nitsche_theta=theta, compiler_flags=("-O0",))[0, 2] for theta in (0, 1, -1)
    )
    for other in others:
        assert other == pytest.approx(incomplete, rel=2e-3)
        assert other != incomplete


@pytest.mark.ranks
@pytest.mark.parametrize("gamma", [1.2, pytest.param(6.0, marks=pytest.mark.slow)])
def test_the_slid_block_feels_mu_times_its_normal_force(gamma):
    x, y, z = forces(2, gamma, (0.02, 0.1, 0.3, 0.6, 0.9, 1.2, 1.5))[-1]
    assert -y / z == pytest.approx(0.3, rel=5e-3)
    assert abs(x) < 5e-3 * z
