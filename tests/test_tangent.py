"""The tissues' part of the Jacobian is kept for some iterations; the result does not change."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np
import pytest
from sphere_on_block import sphere_on_block

from petsc4py import PETSc  # isort: skip

from tactile_fem.mechanics.newton import contact_is_found, struggles

from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.jacobian import Jacobian
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
    with made.linearized():
        made.equilibrium._jacobian.fill()
        return made.snes.getJacobian()[1].copy()


@pytest.fixture
def assembled(monkeypatch) -> Mock:
    """Count how often the tissues' part is assembled."""
    counter = Mock(side_effect=Jacobian.assemble_tissues)
    monkeypatch.setattr(Jacobian, "assemble_tissues", lambda self: counter(self))
    return counter


@pytest.mark.ranks
def test_keeping_the_tissues_part_changes_cost_and_no_result(assembled):
    found, calls = [], []
    for iterations in (1, 4):
        made = problem(tangent_iterations=iterations)
        assembled.reset_mock()
        found.append(go(made))
        calls.append(assembled.call_count)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-8)
    assert calls[1] < 0.6 * calls[0]


def test_newton_goes_on_with_a_new_tangent_where_the_kept_one_leads_astray(assembled):
    made = problem(tangent_iterations=100)
    made.state.reset()
    report = made.solve(np.array(PLACES[0], dtype=float), 0.01)
    assert report.converged
    assert report.residual_N < 1e-11
    assert assembled.call_count > 2  # the first, and those of the second try


def test_a_kept_jacobian_is_that_of_a_new_problem_where_it_is_exact():
    made = problem(tangent_iterations=5)
    go(made)
    other = problem(tangent_iterations=1)
    go(other)
    exact, new = (entries(one) for one in (made, other))
    size = new.norm()
    new.axpy(-1.0, exact)
    assert new.norm() < 1e-6 * size


def test_another_time_step_renews_the_tissues_part(assembled):
    """Viscosity is part of it: over a tenth of the time it is ten times as stiff."""
    made = problem(tangent_iterations=5)
    go(made)
    for dt_s, renewed in ((0.01, 0), (0.0100001, 0), (0.001, 1), (0.001, 0)):
        assembled.reset_mock()
        made.equilibrium._tangent.assemble(dt_s)
        assert assembled.call_count == renewed, dt_s


def test_the_tissues_part_is_renewed_once_where_the_contact_is_found(assembled):
    made = problem(tangent_iterations=5)
    go(made)
    made.equilibrium._tangent.begin_solve()
    for found, renewed in ((False, 0), (True, 1), (True, 0), (False, 0)):
        assembled.reset_mock()
        made.equilibrium._tangent.assemble(0.01, contact_is_found=found)
        assert assembled.call_count == renewed
    made.equilibrium._tangent.begin_solve()  # a step begins with it
    assembled.reset_mock()
    for _ in range(5):
        made.equilibrium._tangent.assemble(0.01)
    assert assembled.call_count == 0
    made.equilibrium._tangent.assemble(0.01)
    assert assembled.call_count == 1


def test_newton_assembles_everything_in_each_iteration(assembled):
    made = problem(tangent_iterations=1)
    made.equilibrium._tangent.begin_solve()
    for _ in range(3):
        made.equilibrium._tangent.assemble(0.01)
    assert assembled.call_count == 3


def test_a_tangent_that_leads_astray_is_renewed_at_once(assembled):
    made = problem(tangent_iterations=5)
    go(made)
    kept = made.equilibrium._tangent
    kept.begin_solve()
    for outdated, renewed in ((False, 0), (True, 1), (False, 0), (True, 1)):
        assembled.reset_mock()
        kept.assemble(0.01, is_outdated=outdated)
        assert assembled.call_count == renewed


@pytest.mark.parametrize(
    "norms, newton, linear, astray",
    [
        ([], 0, 30, False),  # the linear solve was the last step's
        ([1.0], 0, 30, False),
        ([1.0, 0.9], 1, 3, False),  # the contact is not found yet
        ([1.0, 0.9], 1, 11, True),
        ([1.0, 0.05, 0.03], 2, 3, True),
        ([1.0, 0.05, 0.02], 2, 3, False),
    ],
)
def test_slow_solves_and_small_steps_show_that_the_jacobian_is_old(norms, newton, linear, astray):
    snes = Mock()
    snes.getConvergenceHistory.return_value = (norms, None)
    snes.getIterationNumber.return_value = newton
    snes.getKSP.return_value.getIterationNumber.return_value = linear
    assert struggles(snes) is astray


def test_the_contact_is_found_where_the_residual_has_fallen_to_a_tenth():
    snes = Mock()
    for norms, found in (
        ([], False),
        ([1.0], False),
        ([1.0, 3.0, 0.31], False),
        ([3.0, 0.2], True),
    ):
        snes.getConvergenceHistory.return_value = np.array(norms), np.zeros(len(norms))
        assert contact_is_found(snes) == found
