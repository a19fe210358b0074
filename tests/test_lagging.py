"""The tangent is lagged: it is assembled seldom, and the result does not change."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np
import pytest
from sphere_on_block import sphere_on_block

from petsc4py import PETSc  # isort: skip

from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.jacobian import Jacobian
from tactile_fem.solvers.lagging import Lagging
from tactile_fem.study import Tissue

PLACES = [(0, 0, 0.15), (0, 0, 0.3), (0, -0.05, 0.3), (0, -0.1, 0.3)]


def problem(**solver) -> FingerProblem:
    return sphere_on_block(Tissue.model_validate({"set": "proposed"}), **solver)


def go(made: FingerProblem, dt_s: float = 0.01) -> np.ndarray:
    """Press and slide; return the displacements in the file's order."""
    for place in PLACES:
        made.state.reset()
        assert made.solve(np.array(place, dtype=float), dt_s).converged
        made.accept()
    return made.order.gather(made.u)


def entries(made: FingerProblem) -> PETSc.Mat:
    """Return the Jacobian that the linearized problem multiplies by."""
    with made.solver.linearized():
        made.solver._jacobian.fill()
        return made.solver.snes.getJacobian()[1].copy()


@pytest.fixture
def assembled(monkeypatch) -> Mock:
    """Count how often the tangent is assembled."""
    counter = Mock(side_effect=Jacobian.assemble_bulk)
    monkeypatch.setattr(Jacobian, "assemble_bulk", lambda self: counter(self))
    return counter


@pytest.mark.ranks
def test_lagging_changes_the_cost_and_no_result(assembled):
    found, calls = [], []
    for iterations in (1, 4):
        made = problem(tangent_iterations=iterations)
        assembled.reset_mock()
        found.append(go(made))
        calls.append(assembled.call_count)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-8)
    assert calls[1] < 0.6 * calls[0]


def test_newton_goes_on_with_new_tangents_where_a_lagged_one_leads_astray(assembled):
    made = problem(tangent_iterations=100)
    made.state.reset()
    report = made.solve(np.array(PLACES[0], dtype=float), 0.01)
    assert report.converged
    assert report.residual_N < 1e-11
    assert assembled.call_count > 2  # the first, and those of the second try


def test_a_linearization_is_exact_whatever_is_lagged():
    made = problem(tangent_iterations=5)
    go(made)
    other = problem(tangent_iterations=1)
    go(other)
    exact, new = (entries(one) for one in (made, other))
    size = new.norm()
    new.axpy(-1.0, exact)
    assert new.norm() < 1e-6 * size


# --- decisions, without finite elements -----------------------------------------------------------


def snes(norms=(), newton=0, linear=0) -> Mock:
    """Return a solver with residuals so far, and the linear iterations of its last solve."""
    made = Mock()
    made.getConvergenceHistory.return_value = np.array(norms), np.zeros(len(norms))
    made.getIterationNumber.return_value = newton
    made.getKSP.return_value.getIterationNumber.return_value = linear
    made.getConvergedReason.return_value = PETSc.SNES.ConvergedReason.ITERATING
    made.getTolerances.return_value = 0.0, 1e-8, 0.0, 25
    return made


def begun(max_uses: int = 5) -> Lagging:
    """Return decisions within a solve that begins with a tangent."""
    lagging = Lagging(max_uses)
    assert lagging.needs_tangent(snes(), 0.01)  # the very first
    lagging.begin_solve()
    return lagging


def test_a_tangent_is_used_so_often():
    lagging = begun(5)
    assert [lagging.needs_tangent(snes(), 0.01) for _ in range(7)] == 5 * [False] + [True, False]
    every = Lagging(1)
    assert all(every.needs_tangent(snes(), 0.01) for _ in range(3))


def test_another_time_step_renews_the_tangent():
    """Viscosity is part of it: over a tenth of the time it is ten times as stiff."""
    lagging = begun()
    steps = (0.01, False), (0.0100001, False), (0.001, True), (0.001, False)
    for dt_s, renewed in steps:
        assert lagging.needs_tangent(snes(), dt_s) is renewed, dt_s


def test_it_is_renewed_once_where_the_contact_zone_is_found():
    lagging = begun()
    searching, found = snes([3.0, 3.0], 1), snes([3.0, 0.2], 1)
    for there, renewed in ((searching, False), (found, True), (found, False), (searching, False)):
        assert lagging.needs_tangent(there, 0.01) is renewed
    assert lagging.is_of_this_solve
    lagging.begin_solve()
    assert not lagging.is_of_this_solve
    assert lagging.needs_tangent(found, 0.01)


@pytest.mark.parametrize(
    "norms, newton, linear, renewed",
    [
        ([], 0, 30, False),  # the linear solve was the last step's
        ([1.0], 0, 30, False),
        ([1.0, 0.9], 1, 3, False),  # the contact is not found yet
        ([1.0, 0.9], 1, 11, True),
        ([1.0, 0.05, 0.03], 2, 3, True),
        ([1.0, 0.05, 0.02], 2, 3, False),
    ],
)
def test_slow_solves_and_slow_iterations_show_that_it_is_out_of_date(
    norms, newton, linear, renewed
):
    lagging = begun()
    lagging.is_of_this_solve = True
    there = snes(norms, newton, linear)
    assert lagging.needs_tangent(there, 0.01) is renewed
    assert lagging.needs_preconditioner(there) is (linear == 11)


def test_off_is_newtons_method():
    lagging = begun()
    with lagging.off():
        assert all(lagging.needs_tangent(snes(), 0.01) for _ in range(3))
    assert not lagging.needs_tangent(snes(), 0.01)


@pytest.mark.parametrize(
    "norms, spared",
    [([1.0], False), ([1e-3, 1e-5], False), ([1e-4, 1e-6], False), ([1e-4, 1e-7], True)],
)
def test_the_last_iteration_does_without(norms, spared):
    """At 1e-4, 1e-7 the old Jacobian promises 1e-10; four times as much is below 1e-8."""
    assert Lagging.needs_nothing(snes(norms)) is spared
