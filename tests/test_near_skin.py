"""Only skin near the body is integrated, and nothing is lost by it: the plain solver takes all."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from sphere_on_block import BALL, follow, sphere_on_block

from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.near_skin import NearSkin
from tactile_fem.solvers.plain import PlainSolver
from tactile_fem.stimulus.body import Distance, RigidBody
from tactile_fem.study import Dots, Text

AT_EDGE, IN_MIDDLE, FAR = (2.6, 0.0, 0.2), (0.0, 0.0, 0.2), (0.0, 0.0, -5.0)


@dataclass
class Counted:
    """A body that knows at how many points its distance was evaluated."""

    body: RigidBody
    counts: list[int] = field(default_factory=list)

    def distance(self, points: np.ndarray) -> Distance:
        self.counts.append(len(points))
        return self.body.distance(points)


def displaced(made: FingerProblem, size_mm: float) -> None:
    """Displace each node by up to so much, the same on any number of ranks."""
    made.u.interpolate(lambda x: size_mm * np.sin([9 * x[1] + x[0], 7 * x[0], 5 * x[0] - 8 * x[1]]))


def lowered(made: FingerProblem, by_mm: float) -> None:
    made.u.interpolate(lambda x: np.array([0 * x[0], 0 * x[0], 0 * x[0] - by_mm]))


def check(fast: FingerProblem, plain: FingerProblem, place, displace=displaced, size=0.0) -> float:
    """Compare the residuals with the body at `place`; return the largest."""
    for made in (fast, plain):
        displace(made, size)
        made.u.x.array.reshape(-1, 3)[made.held] = 0.0
        made.state.translation.value[:] = place
    found, wanted = fast.solver.residual(), plain.solver.residual()
    largest = fast.domain.comm.allreduce(np.abs(wanted).max(initial=0), max)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * largest + 1e-15)
    return largest


def pair(**more) -> tuple[FingerProblem, FingerProblem]:
    return sphere_on_block(**more), sphere_on_block(make_solver=PlainSolver, **more)


@pytest.mark.ranks
@pytest.mark.parametrize("size_mm", [0.01, 0.1, 0.2])
def test_skin_that_moves_or_that_the_body_comes_to_is_evaluated_again(size_mm):
    ball = Counted(BALL)
    fast, plain = pair(body=ball)
    assert check(fast, plain, IN_MIDDLE) > 1e-3
    ball.counts.clear()
    check(fast, plain, IN_MIDDLE, displaced, size_mm)
    evaluated, whole = (
        fast.domain.comm.allreduce(sum(n)) for n in (ball.counts[:-1], ball.counts[-1:])
    )
    assert 0 < evaluated < whole or size_mm == 0.2
    for place in (AT_EDGE, FAR, IN_MIDDLE):
        check(fast, plain, place)


@pytest.mark.ranks
@pytest.mark.parametrize(
    "stimulus", [Dots(relief_mm=2.0), Text(text="G", relief_mm=2.0, start_mm=0.0)]
)
def test_contact_with_high_reliefs_is_not_overlooked(stimulus):
    """Skin seen from above the reliefs moves down onto them within a solve."""
    fast, plain = pair(body=stimulus.body())
    check(fast, plain, (0.0, 0.0, -0.55))
    assert check(fast, plain, (0.0, 0.0, -0.55), lowered, 0.6) > 1e-4


@pytest.mark.slow
def test_untouched_skin_is_integrated_where_it_is_in_the_form():
    fast, plain = pair(nitsche_theta=1, nitsche_gamma=40.0, compiler_flags=("-O0",))
    check(fast, plain, FAR, displaced, 0.1)


@pytest.mark.ranks
def test_distant_skin_is_left_out_and_wider_contact_reaches_farther():
    made = sphere_on_block()
    made.state.translation.value[:] = IN_MIDDLE
    near = NearSkin(made.contact)
    counts = []
    for width in (1.0, 20.0):
        with made.contact.regularized(width, 0.3):
            near.begin_solve()
            near.update()
        counts.append(made.domain.comm.allreduce(sum(map(len, near.chosen.values()))))
    assert 0 < counts[0] < counts[1]
    assert counts[0] < made.domain.comm.allreduce(sum(map(len, near.all.values())))


@pytest.mark.ranks
def test_the_load_is_of_all_skin():
    """Whatever a solve overlooked shows in the load, as an imbalance."""
    made = sphere_on_block()
    balanced = follow(made, IN_MIDDLE)
    lowered(made, 0.1)
    loads = []
    for reach_mm in (1e6, -1e6):  # the second time all skin counts as out of reach
        made.contact.obstacle.skip_distant(np.full(len(made.contact.obstacle.gap_mm), reach_mm))
        loads.append(made.load().force_N)
    assert loads[0][2] > 2 * balanced.force_N[2]
    np.testing.assert_array_equal(*loads)
