"""Multigrid: same iterations on any number of ranks, and few of them under a thin stiff layer."""

from __future__ import annotations

import logging
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from dolfinx import fem  # isort: skip
from mpi4py import MPI  # isort: skip

from blocks import LAYERS, block_mesh

from tactile_fem.mechanics.domain import NodeOrder, create_domain
from tactile_fem.solvers import lagging
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.lagging import Lagging
from tactile_fem.study import Solver, Sphere, Tissue

DEPTHS = np.array([0.0, 0.17, 0.82, 1.62, 4.0])
TIGHT = {"snes_atol": 1e-10}
# Every solve to the same accuracy: Newton's path is then the same for every linear solver. With
# converged bounds of the smoother's spectrum: ten steps from noise, which is other on other ranks,
# leave several percent of the iterations to chance, forty still two.
STRICT = {
    "snes_ksp_ew": False,
    "ksp_rtol": 1e-3,
    "ksp_max_it": 200,
    "mg_levels_ksp_chebyshev_esteig_steps": 80,
}


def pressed(comm=MPI.COMM_WORLD, **solver) -> tuple[FingerProblem, int]:
    """Press a ball into a layered block; return the problem and its linear iterations."""
    line = np.linspace(-5, 5, 8)
    mesh = block_mesh(line, line, DEPTHS, LAYERS) if comm.rank == 0 else None
    domain = create_domain(mesh, comm, ("cut",))
    settings = Solver(held=("cut",), **solver)
    body = Sphere(radius_mm=3.0).body()
    tissue = Tissue.model_validate({"set": "proposed"})
    problem = FingerProblem(domain, tissue, body, 0.3, settings)
    linear = 0
    for place in ((0, 0, 0.2), (0, 0, 0.4), (0, -0.05, 0.4)):
        report = problem.solve(np.array(place, dtype=float), 0.01)
        assert report.converged
        problem.accept()
        linear += report.linear_iterations
    return problem, linear


@pytest.fixture
def always_set_up(monkeypatch):
    """Set multigrid up with each Jacobian: what is kept would blur what the smoother is worth."""
    monkeypatch.setattr(Lagging, "needs_preconditioner", lambda self, snes: True)


@pytest.mark.ranks
def test_multigrid_finds_what_the_direct_solver_finds():
    problems = [pressed(linear=linear, petsc=TIGHT)[0] for linear in ("multigrid", "direct")]
    displacements = [problem.order.gather(problem.u) for problem in problems]
    scale = np.abs(displacements[1]).max()
    assert np.abs(displacements[0] - displacements[1]).max() < 1e-7 * scale


@pytest.mark.ranks
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="runs on several ranks")
@pytest.mark.usefixtures("always_set_up")
def test_iterations_do_not_depend_on_the_number_of_ranks():
    one, several = (pressed(comm, petsc=STRICT)[1] for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
    # Rounding may turn one iteration; lines cut at the ranks' borders would double them.
    assert several == pytest.approx(one, rel=0.01)


@pytest.mark.usefixtures("always_set_up")
def test_lines_through_the_layers_are_worth_it():
    """Point blocks in their place need at least three times the iterations."""
    lines = pressed(petsc=STRICT)[1]
    points = pressed(petsc={**STRICT, "mg_levels_pc_type": "pbjacobi"})[1]
    assert points > 3 * lines


@pytest.mark.parametrize("linear", ["multigrid", "direct"])
def test_the_last_step_spares_a_jacobian_and_loses_nothing(linear, monkeypatch):
    """As near the solution as with a Jacobian for each step, in as many steps."""
    # From here Newton's residuals fall from 6e-6 to 2e-8 and below 1e-9 N: the old Jacobian
    # promises 1e-10 N for the last step, a tenth of what is asked.
    problem, _ = pressed(linear=linear, petsc={**STRICT, "snes_atol": 1e-9}, tangent_iterations=1)
    guess = problem.u.x.array.copy()
    jacobian = problem.solver._jacobian
    built = Mock(wraps=jacobian.assemble_contact)
    monkeypatch.setattr(jacobian, "assemble_contact", built)
    found = {}
    for caution in (4.0, np.inf):
        monkeypatch.setattr(lagging, "_SAFETY_FACTOR", caution)
        problem.u.x.array[:] = guess
        built.reset_mock()
        report = problem.solve(np.array([0, -0.0503, 0.4]), 0.01)
        assert report.residual_N < 1e-9
        found[caution] = problem.u.x.array.copy(), report.iterations, built.call_count
    near, steps, few = found[4.0]
    exact, all_steps, many = found[np.inf]
    assert steps == all_steps == many
    assert few == many - 1
    assert np.abs(near - exact).max() < 1e-6 * np.abs(exact).max()


@pytest.mark.ranks
def test_no_linear_solve_goes_further_than_newton_will():
    problem, _ = pressed()
    assert problem.solver.snes.getKSP().getTolerances()[1] == pytest.approx(0.3 * 1e-8)
    report = problem.solve(np.array([0, -0.1, 0.4]), 0.01)
    assert 1e-10 < report.residual_N < 1e-8


def test_a_line_is_inverted_whole():
    problem, _ = pressed()
    matrix = problem.solver.snes.getJacobian()[1]
    smoother = problem.solver.snes.getKSP().getPC().getMGSmoother(1).getPC()
    problem.solver._jacobian.fill()
    smoother.getPythonContext().invert(matrix)
    dense = matrix.convert("dense", out=type(matrix)()).getDenseArray()
    x, y = matrix.createVecs()
    random = np.random.default_rng(0)
    x.array = random.normal(size=x.getSize())
    smoother.getPythonContext().apply(smoother, x, y)
    blocks = problem.order.blocks()
    assert max(block.shape[1] for block in blocks) == 7  # nodes through three rows
    assert sum(block.size for block in blocks) * 3 == x.getSize()
    for block in blocks:
        dofs = (3 * block[0][:, None] + np.arange(3)).ravel()
        exact = np.linalg.solve(dense[np.ix_(dofs, dofs)], x.array[dofs])
        np.testing.assert_allclose(y.array[dofs], exact, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("columns", [True, False])
def test_layers_without_columns_are_told(columns, caplog, monkeypatch):
    monkeypatch.setattr(logging.getLogger("tactile_fem"), "propagate", True)
    line = np.linspace(-5, 5, 8)
    domain = create_domain(block_mesh(line, line, DEPTHS, LAYERS), MPI.COMM_SELF, ("cut",))
    if not columns:  # as where one node of the skin lies over many nodes of fine tetrahedra
        domain = replace(domain, line=np.where(domain.line >= 0, 0, -1))
    NodeOrder(domain, fem.functionspace(domain.mesh, ("Lagrange", 2, (3,)))).blocks()
    assert ("100 % of the nodes in the skin's layers" in caplog.text) != columns
