"""Tangent and preconditioner serve two steps; from the states between, a scan can go on."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np
import pytest
from sphere_on_block import sphere_on_block

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
def test_every_second_step_sets_up_anew(monkeypatch):
    made = problem()
    multigrid = made.equilibrium._two_level
    assert made.is_resumable  # nothing was made yet
    set_ups, resumable = [], []
    for place in PLACES:
        counter = Mock(wraps=multigrid.set_up)
        monkeypatch.setattr(multigrid, "set_up", counter)
        step(made, place)
        set_ups.append(counter.call_count)
        resumable.append(made.is_resumable)
        monkeypatch.undo()
    assert resumable == [True, False] * 3
    # The first step sets up for its own iterations as well.
    assert set_ups == [2, 0, 1, 0, 1, 0]


@pytest.mark.ranks
@pytest.mark.parametrize("at", [1, 3])
def test_what_is_restored_where_it_is_resumable_takes_the_same_iterations(at):
    made, other = problem(), problem()
    for place in PLACES[:at]:
        step(made, place)
    assert made.is_resumable
    other.restore(made.state.gather(made.order))
    for place in PLACES[at:]:
        assert step(other, place) == step(made, place)
        scale = np.abs(made.u.x.array).max()
        np.testing.assert_allclose(other.u.x.array, made.u.x.array, rtol=0, atol=1e-12 * scale)
        assert other.is_resumable == made.is_resumable


@pytest.mark.ranks
def test_what_is_restored_after_a_step_without_iterations_takes_the_same():
    made, other = problem(), problem()
    step(made, PLACES[0])
    tolerance = made.snes.getTolerances()[1]
    made.snes.setTolerances(atol=1.0)
    for _ in range(2):
        step(made, PLACES[0])
        assert made.snes.getIterationNumber() == 0
    made.snes.setTolerances(atol=tolerance)
    assert made.is_resumable
    other.restore(made.state.gather(made.order))
    for place in PLACES[1:3]:
        assert step(other, place) == step(made, place) > 0
        assert other.is_resumable == made.is_resumable
