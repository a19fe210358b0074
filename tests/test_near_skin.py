"""Only skin near the body is integrated, and nothing is lost by it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from sphere_on_block import sphere_on_block

from dolfinx import fem  # isort: skip
from mpi4py import MPI  # isort: skip

from tactile_fem.mechanics.contact_law import ZERO_BELOW, smooth_positive
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Dots, Text, Tissue

AT_EDGE, IN_MIDDLE = (2.6, 0.0, 0.2), (0.0, 0.0, 0.2)


def problem(**solver) -> FingerProblem:
    return sphere_on_block(Tissue.model_validate({"set": "proposed"}), **solver)


def look(made: FingerProblem, place: tuple[float, float, float]) -> None:
    """Look from the body at `place` which skin is near."""
    made.state.translation.value[:] = place
    made.solver._near.update()


def facets(made: FingerProblem) -> set[tuple[int, int]]:
    """Return the facets that are near, on this rank."""
    pairs = np.concatenate([pairs.reshape(-1, 2) for pairs in made.solver._near.chosen.values()])
    return set(map(tuple, pairs.tolist()))


def count(made: FingerProblem) -> int:
    return made.domain.comm.allreduce(len(facets(made)))


@pytest.mark.ranks
def test_far_skin_adds_nothing():
    made = problem()
    assert made.solve(np.array(IN_MIDDLE), 0.01).converged
    cell = made.load_cell  # it integrates over the whole skin
    whole = [fem.assemble_vector(form).array for form in (cell._pressure_form, cell._friction_form)]
    near = fem.assemble_vector(made.solver._contact()).array
    assert made.domain.comm.allreduce(np.abs(near).max(initial=0), MPI.MAX) > 1e-3  # N
    np.testing.assert_allclose(near, -sum(whole), rtol=0, atol=1e-15)
    everything = made.domain.comm.allreduce(
        sum(len(pairs) // 2 for pairs in made.solver._near.all.values())
    )
    assert 0 < count(made) < everything


@pytest.mark.ranks
def test_skin_is_chosen_as_the_body_comes():
    made = problem()
    look(made, AT_EDGE)
    first = facets(made)
    look(made, AT_EDGE)
    assert facets(made) == first
    look(made, IN_MIDDLE)
    assert facets(made) >= first
    assert count(made) > made.domain.comm.allreduce(len(first))
    made.solver._near.begin_solve()
    look(made, AT_EDGE)
    assert facets(made) == first


def displaced(made: FingerProblem, size_mm: float) -> None:
    """Displace each node by up to so much, the same on any number of ranks."""
    made.u.interpolate(lambda x: size_mm * np.sin([9 * x[1] + x[0], 7 * x[0], 5 * x[0] - 8 * x[1]]))


@pytest.mark.ranks
@pytest.mark.parametrize("size_mm", [0.01, 0.1, 1.0])
def test_skin_that_may_have_come_near_is_looked_at_again(size_mm, monkeypatch):
    made, fresh = problem(), problem()
    look(made, IN_MIDDLE)
    seen = []
    body = made.contact.obstacle.body
    spy = SimpleNamespace(distance=lambda y: seen.append(len(y)) or body.distance(y))
    monkeypatch.setattr(made.contact.obstacle, "body", spy)
    for one in (made, fresh):
        displaced(one, size_mm)
        look(one, IN_MIDDLE)
    sum_of = made.domain.comm.allreduce
    looked_at, every = sum_of(sum(seen)), sum_of(len(made.contact.obstacle.points_mm))
    assert (0 < looked_at < every) or size_mm == 1.0
    gaps = [one.contact.obstacle.gap_mm.min(axis=1, initial=np.inf) for one in (made, fresh)]
    near = np.minimum(*gaps) < 0.04
    assert sum_of(int(near.sum()))
    np.testing.assert_array_equal(gaps[0][near], gaps[1][near])
    # The next solve looks everywhere.
    made.solver._near.begin_solve()
    look(made, IN_MIDDLE)
    np.testing.assert_array_equal(made.contact.obstacle.gap_mm, fresh.contact.obstacle.gap_mm)


@pytest.mark.ranks
@pytest.mark.parametrize(
    "stimulus", [Dots(relief_mm=2.0), Text(text="G", relief_mm=2.0, start_mm=0.0)]
)
def test_contact_with_high_reliefs_is_not_overlooked(stimulus):
    """Skin seen from above the reliefs moves down onto them within a solve."""
    made = problem()
    made.contact.obstacle.body = stimulus.body()
    look(made, (0.0, 0.0, -0.55))
    made.u.interpolate(lambda x: np.array([0 * x[0], 0 * x[0], 0 * x[0] - 0.6]))
    look(made, (0.0, 0.0, -0.55))
    lowest = made.domain.comm.allreduce(made.contact.obstacle.gap_mm.min(initial=np.inf), MPI.MIN)
    assert lowest == pytest.approx(-0.05, abs=1e-6)
    assert count(made) > 0


@pytest.mark.ranks
def test_the_load_is_of_all_skin():
    """Whatever a solve overlooked shows in the load, as an imbalance."""
    made = problem()
    assert made.solve(np.array(IN_MIDDLE), 0.01).converged
    balanced = made.load()
    made.contact.obstacle._gap.x.array[:] = 5.0  # as if the body had been far away
    made.contact.obstacle.skip_distant(np.zeros(len(made.contact.obstacle.entities)))
    np.testing.assert_allclose(made.load().force_N, balanced.force_N, rtol=1e-9)


@pytest.mark.ranks
def test_a_body_that_moved_is_looked_at_from_everywhere():
    made, fresh = problem(), problem()
    look(made, AT_EDGE)
    for one in (made, fresh):
        look(one, IN_MIDDLE)
    np.testing.assert_array_equal(made.contact.obstacle.gap_mm, fresh.contact.obstacle.gap_mm)


def test_wider_contact_reaches_farther():
    made = problem()
    look(made, IN_MIDDLE)
    few = count(made)
    with made.contact.regularized(20.0, 0.3):
        made.solver._near.begin_solve()
        look(made, IN_MIDDLE)
    assert count(made) > few


@pytest.mark.slow
def test_all_skin_is_near_where_untouched_skin_is_in_the_form():
    made = problem(nitsche_theta=1, nitsche_gamma=40.0)
    look(made, (0.0, 0.0, -5.0))
    assert count(made) == sum(len(pairs) // 2 for pairs in made.solver._near.all.values())


@pytest.mark.parametrize("width", [0.005, 0.1])
def test_the_smooth_positive_part_is_zero_below_so_many_widths(width):
    assert float(smooth_positive(-ZERO_BELOW * width, width)) == 0.0
    assert float(smooth_positive(-0.9 * ZERO_BELOW * width, width)) > 0.0
