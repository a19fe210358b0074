"""The tangent is lagged: it is assembled seldom, and the result does not change."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np
import pytest
from sphere_on_block import PRESS_AND_SLIDE, follow, sphere_on_block

from dolfinx import common  # isort: skip
from petsc4py import PETSc  # isort: skip

from tactile_fem.solvers.lagging import Lagging


def assembled() -> int:
    """Return how often this process has assembled a tangent of the tissues."""
    try:
        return common.timing("tactile: tangent of the bulk")[0]
    except RuntimeError:  # none so far
        return 0


@pytest.mark.ranks
def test_lagging_changes_the_cost_and_no_result():
    found, counts = [], []
    for iterations in (1, 4):
        made, before = sphere_on_block(tangent_iterations=iterations), assembled()
        follow(made, *PRESS_AND_SLIDE)
        found.append(made.u.x.array.copy())
        counts.append(assembled() - before)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-8)
    assert counts[1] < 0.6 * counts[0]


def test_newton_goes_on_with_new_tangents_where_a_lagged_one_leads_astray():
    made, before = sphere_on_block(tangent_iterations=100), assembled()
    follow(made, PRESS_AND_SLIDE[0])
    assert assembled() - before > 3  # the first, those of the second try, that of the next step


# --- decisions, without finite elements -----------------------------------------------------------


def snes(norms=(), linear: int = 0) -> Mock:
    """Return a solver with residuals so far, and the linear iterations of its last solve."""
    made = Mock()
    made.getConvergenceHistory.return_value = np.array(norms), np.zeros(len(norms))
    made.getIterationNumber.return_value = max(len(norms) - 1, 0)
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


SEARCHING, FOUND = snes([3.0, 3.0]), snes([3.0, 0.2])
SLOW, FAST = snes([3.0, 0.2, 0.12]), snes([3.0, 0.2, 0.08])
SOLVED_SLOWLY, OF_LAST_STEP = snes([3.0, 3.0], 11), snes([3.0], 30)
# Where the solver is, the time step, and whether the tangent is new, one call after the other.
CASES = {
    "used so often": [(SEARCHING, 0.01, renewed) for renewed in [*(5 * [False]), True, False]],
    "another time step": [
        (SEARCHING, dt_s, renewed)
        for dt_s, renewed in [(0.0100001, False), (0.001, True), (0.001, False)]
    ],
    "contact found": [(SEARCHING, 0.01, False), (FOUND, 0.01, True), (FOUND, 0.01, False)],
    "slow iteration": [(FOUND, 0.01, True), (FAST, 0.01, False), (SLOW, 0.01, True)],
    "slow linear solve": [(OF_LAST_STEP, 0.01, False), (SOLVED_SLOWLY, 0.01, True)],
}


@pytest.mark.parametrize("case", CASES)
def test_a_tangent_is_renewed_where_it_is_out_of_date(case):
    lagging = begun()
    for there, dt_s, renewed in CASES[case]:
        assert lagging.needs_tangent(there, dt_s) is renewed
        assert lagging.needs_preconditioner(there) is (there is SOLVED_SLOWLY)


def test_off_is_newtons_method():
    lagging = begun()
    with lagging.off():
        assert all(lagging.needs_tangent(snes(), 0.01) for _ in range(3))
    assert not lagging.needs_tangent(snes(), 0.01)


@pytest.mark.parametrize(
    "norms, spared", [([1.0], False), ([1e-4, 1e-6], False), ([1e-4, 1e-7], True)]
)
def test_the_last_iteration_does_without(norms, spared):
    """At 1e-4, 1e-7 the old Jacobian promises 1e-10; four times as much is below 1e-8."""
    assert Lagging.needs_nothing(snes(norms)) is spared
