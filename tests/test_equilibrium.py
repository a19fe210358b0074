"""A step begins with what the last one left; from any state, a scan can go on."""

from __future__ import annotations

import numpy as np
import pytest
from sphere_on_block import sphere_on_block

from tactile_fem.solvers import multigrid
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Tissue

PLACES = [(0, 0, 0.1), (0, 0, 0.2), (0, 0, 0.3), (0, -0.05, 0.3), (0, -0.1, 0.3), (0, -0.15, 0.3)]


def problem(**solver) -> FingerProblem:
    return sphere_on_block(Tissue.model_validate({"set": "proposed"}), **solver)


def step(made: FingerProblem, place: tuple[float, float, float]) -> int:
    """Take a step; return the iterations of the linear solver."""
    made.state.reset()
    report = made.solve(np.array(place, dtype=float), 0.01)
    assert report.converged
    made.accept()
    return report.linear_iterations


@pytest.mark.ranks
@pytest.mark.parametrize("at", range(1, len(PLACES)))
@pytest.mark.parametrize("linear", ["multigrid", "aggregated", "direct"])
def test_what_is_restored_after_any_step_takes_the_same_iterations(at, linear, monkeypatch):
    if linear == "aggregated":
        monkeypatch.setattr(multigrid, "_MOST_TO_FACTORIZE", 0)
        linear = "multigrid"
    made, other = problem(linear=linear), problem(linear=linear)
    for place in PLACES[:at]:
        step(made, place)
    other.restore(made.gather())
    for place in PLACES[at:]:
        assert step(other, place) == step(made, place)
        scale = np.abs(made.u.x.array).max()
        np.testing.assert_allclose(other.u.x.array, made.u.x.array, rtol=0, atol=1e-12 * scale)


@pytest.mark.ranks
def test_what_is_restored_after_a_step_without_iterations_takes_the_same():
    made, other = problem(), problem()
    step(made, PLACES[0])
    tolerance = made.solver.snes.getTolerances()[1]
    made.solver.snes.setTolerances(atol=1.0)
    for _ in range(2):
        step(made, PLACES[0])
        assert made.solver.snes.getIterationNumber() == 0
    made.solver.snes.setTolerances(atol=tolerance)
    other.restore(made.gather())
    for place in PLACES[1:3]:
        assert step(other, place) == step(made, place) > 0
