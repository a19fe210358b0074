"""Nearly incompressible tissue on a coarse mesh: what locks, and what does not."""

from __future__ import annotations

import numpy as np
import pytest
import ufl

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import block_mesh
from dolfinx import fem
from materials import NO_VISCOSITY_S
from sphere_on_block import follow
from terms import Bulk

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Solver, Sphere, Tissue

RATIO = 25.0
EVERY_POINT = 1e9
BALL = Sphere(radius_mm=3.0)


def soft(bulk_over_shear: float) -> Tissue:
    """Return tissues whose dermis is neo-Hookean, of 1 kPa."""
    dermis = {"C10_MPa": 5e-4, "C20_MPa": 0.0, "D1_per_MPa": 2 / (1e-3 * bulk_over_shear)}
    return Tissue.model_validate({"viscous_time_s": NO_VISCOSITY_S, "dermis": dermis})


def force(count: int, bulk_over_shear: float, locking_ratio: float) -> float:
    """Return the force on a ball that is pressed a third of the way through a bonded block."""
    line, up = np.linspace(-4, 4, 2 * count + 1), np.linspace(0, 3, count + 1)
    block = block_mesh(line, line, up, ["dermis"] * count)
    solver = Solver(held=("cut",), linear="direct", locking_ratio=locking_ratio)
    domain = create_domain(block, MPI.COMM_WORLD, solver.held)
    problem = FingerProblem(domain, soft(bulk_over_shear), BALL.body(), BALL.friction, solver)
    return float(follow(problem, *((0, 0, z) for z in (0.2, 0.4, 0.6, 0.8, 1.0))).force_N[2])


@pytest.mark.ranks
def test_large_strains_lock_unless_volume_change_counts_at_the_centres():
    fine = force(3, 176.0, RATIO)
    whole, unlocked = (force(2, 176.0, ratio) for ratio in (EVERY_POINT, RATIO))
    assert fine < unlocked < fine + 0.7 * (whole - fine)


def test_what_cannot_lock_stays_as_it_is():
    assert force(1, 24.0, RATIO) == force(1, 24.0, EVERY_POINT)


def test_a_homogeneous_state_is_the_same():
    """Its volume change is that of the elements' centres."""
    line = np.linspace(0.0, 1.0, 2)
    block = block_mesh(line, line, np.linspace(0, 1, 3), ["dermis"] * 2)
    domain = create_domain(block, MPI.COMM_WORLD, ("cut",))
    x = ufl.SpatialCoordinate(domain.mesh)
    A = ufl.as_matrix([[0.1, 0.2, 0.0], [0.0, -0.2, 0.1], [0.05, 0.0, 0.15]])
    residuals, energies = [], []
    for ratio in (EVERY_POINT, RATIO):
        bulk = Bulk(domain, soft(1000.0), Solver(locking_ratio=ratio))
        bulk.u.interpolate(fem.Expression(A * x, bulk.V.element.interpolation_points))
        v, one = ufl.TestFunction(bulk.V), fem.Constant(domain.mesh, 1.0)
        residuals.append(fem.assemble_vector(fem.form(bulk.residual(v))).array)
        energies.append(fem.assemble_scalar(fem.form(bulk.stored(one))))
    np.testing.assert_allclose(*residuals, rtol=0, atol=1e-12 * np.abs(residuals[0]).max())
    assert energies[0] == pytest.approx(energies[1], rel=1e-12) and energies[0] > 0


@pytest.mark.parametrize("ratio", [EVERY_POINT, RATIO])
def test_the_residual_is_the_energys_derivative(ratio):
    line = np.linspace(0.0, 1.0, 2)
    block = block_mesh(line, line, np.linspace(0, 1, 3), ["dermis"] * 2)
    domain = create_domain(block, MPI.COMM_WORLD, ("cut",))
    bulk = Bulk(domain, soft(1000.0), Solver(locking_ratio=ratio))
    u, way = bulk.u, fem.Function(bulk.V)
    rng = np.random.default_rng(2)
    start, step = (0.03 * rng.normal(size=u.x.array.size) for _ in range(2))
    way.x.array[:] = step
    stored = fem.form(bulk.stored(fem.Constant(domain.mesh, 1.0)))
    energies = []
    for h in (1e-4, -1e-4):
        u.x.array[:] = start + h * step
        energies.append(fem.assemble_scalar(stored))
    u.x.array[:] = start
    work = fem.assemble_scalar(fem.form(bulk.residual(way)))
    assert work == pytest.approx((energies[0] - energies[1]) / 2e-4, rel=1e-6)
