"""Step control needs no finite element."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_fem.errors import ConvergenceError
from tactile_fem.mechanics.problem import SolveReport
from tactile_fem.mechanics.step_control import StepControl, StepTooSmallError
from tactile_fem.mechanics.stepper import Stepper
from tactile_fem.runtime import backend  # noqa: F401
from tactile_fem.study import Protocol, Solver


def walk(control: StepControl, iterations=lambda position: 4) -> list[float]:
    places = []
    while not control.finished:
        target = control.target_mm()
        control.accept(target, iterations(target))
        places.append(target)
    return places


def test_hits_every_milestone_exactly_with_steps_within_bounds():
    milestones = tuple(0.3 * np.arange(1, 8))
    places = walk(StepControl(2.0, 0.01, 0.25, 1e-3, milestones))
    assert set(milestones[:-1]) <= set(places)
    assert places[-1] == 2.0
    steps = np.diff([0.0, *places])
    assert steps.min() > 0
    assert steps.max() <= 0.25 + 1e-12


def test_easy_steps_grow_hard_ones_do_not():
    easy = walk(StepControl(2.0, 0.01, 0.5, 1e-3))
    hard = walk(StepControl(2.0, 0.01, 0.5, 1e-3), lambda position: 20)
    assert easy[1] - easy[0] == pytest.approx(0.02, rel=0.1)
    assert len(hard) == 200
    assert len(easy) < 15


def test_a_step_cut_short_by_a_milestone_does_not_shorten_the_next():
    control = StepControl(1.0, 0.2, 0.2, 1e-3, (0.21,))
    places = walk(control)
    assert places[:2] == pytest.approx([0.105, 0.21])
    assert max(np.diff(places)) > 0.15


def test_failure_halves_until_the_floor():
    control = StepControl(1.0, 0.4, 0.4, 0.06)
    target = control.target_mm()
    control.reject(target)
    assert control.target_mm() == pytest.approx(target / 2, rel=0.1)
    with pytest.raises(StepTooSmallError):
        for _ in range(10):
            control.reject(control.target_mm())
    assert control.position_mm == 0.0


def test_after_a_failure_the_step_grows_only_when_it_has_been_easy_for_a_while():
    control = StepControl(10.0, 0.2, 0.2, 1e-3, patience=3)
    control.reject(control.target_mm())
    taken = []
    for _ in range(6):
        target = control.target_mm()
        taken.append(target - control.position_mm)
        control.accept(target, 4)
    assert taken == pytest.approx([0.1, 0.1, 0.1, 0.1, 0.2, 0.2], rel=0.05)


def test_milestone_is_reported():
    control = StepControl(1.0, 0.5, 0.5, 0.1, (0.5,))
    control.accept(0.25, 4)
    assert not control.at_milestone
    control.accept(0.5, 4)
    assert control.at_milestone


@pytest.mark.parametrize(("speed", "briefest"), [(200.0, 0.01), (20.0, 0.01), (2.0, 0.001)])
def test_a_slow_motion_may_step_as_briefly_as_a_fast_one(speed, briefest):
    """Viscosity, which holds what snaps, acts over a time."""
    tried = []

    def fail(place, dt):
        tried.append(speed * dt)
        return SolveReport(False, 1, 1, 1.0, "always")

    at_rest = SimpleNamespace(x=SimpleNamespace(array=np.zeros(3)))
    stick = SimpleNamespace(old=at_rest)
    problem = SimpleNamespace(u=at_rest, u_old=at_rest, stick=stick, solve=fail)
    protocol = Protocol(press_speed_mm_s=speed)
    with pytest.raises(ConvergenceError):
        list(Stepper(problem, protocol, Solver(min_step_mm=0.01), 1.0))
    assert briefest <= min(tried) < 2 * briefest
