"""Steps along a path, with a spring in place of the finger."""

from __future__ import annotations

import logging
import re
from itertools import islice

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip

from mpi4py import MPI

from blocks import block_mesh
from dolfinx import fem

from tactile_fem.errors import ConvergenceError
from tactile_fem.mechanics.domain import NodeOrder, create_domain
from tactile_fem.mechanics.load import Load
from tactile_fem.mechanics.rows import Snapshot, gathered
from tactile_fem.mechanics.state import State
from tactile_fem.path import Hold, Lift, Motion, Path, Press, Protocol, Slide
from tactile_fem.simulation.step import Step
from tactile_fem.simulation.stepper import Stepper
from tactile_fem.solvers.report import SolveReport
from tactile_fem.study import Solver

SOLVER = Solver(first_step_mm=0.1, max_press_step_mm=0.2)
CORNERS = np.array([0.0, 1.0])


def press(depth_mm, until_N=None):
    if until_N is None:
        return Press(depth_mm=depth_mm, speed_mm_s=10.0)
    return Press(force_N=until_N, speed_mm_s=10.0).resolved(depth_mm)


TO_FORCE = Path(
    (
        press(3.0, until_N=0.4),
        Hold(time_s=0.1, output_s=0.05, force_N=0.4),
        Slide(by_mm=(0.0, -1.0), output_mm=0.25, force_N=0.4),
        Lift(depth_mm=-0.1),
    )
)


class Spring:
    """A problem whose normal force is ``z^1.5``, and softer the further it slides."""

    def __init__(self) -> None:
        brick = block_mesh(CORNERS, CORNERS, CORNERS, ["dermis"])
        self.domain = create_domain(brick, MPI.COMM_SELF, ("cut",))
        V = fem.functionspace(self.domain.mesh, ("Lagrange", 2, (3,)))
        self.state, self.order, self.solves = State(V), NodeOrder(self.domain, V), []

    def solve(self, place: np.ndarray, dt_s: float, rotation: np.ndarray, swing) -> SolveReport:
        self.state.move(place, rotation, swing)
        self.state.time_step.value = dt_s
        self.solves.append((place, dt_s))
        return SolveReport(True, 3, 9, 0.0, "")

    def load(self) -> Load:
        x, y, z = self.state.translation.value
        normal = max(z, 0.0) ** 1.5 / (1 + 0.2 * np.hypot(x, y))
        force = np.array([0.0, -0.3 * normal, normal])
        return Load(force, *3 * [np.zeros(3)], *8 * [0.0], *3 * [np.zeros((0, 3))])

    def rejection(self, load: Load) -> str:
        return load.rejection(balance_N=1e-5)

    def accept(self, load: Load) -> None:
        self.state.accept(load.force_N, load.moment_Nmm, load.friction_N, 3)

    def to_save(self) -> Snapshot:
        return self.state.to_save(self.order)

    def restore(self, saved) -> None:
        self.state.restore(saved, self.order)


def steps_of(path: Path, solver: Solver = SOLVER) -> list[Step]:
    return list(Stepper(Spring(), path, solver))


def of(steps: list[Step], phase: str) -> list[Step]:
    return [step for step in steps if step.phase == phase]


def test_the_papers_path_is_pressed_and_slid():
    path = Protocol(depth_mm=1.0, distance_mm=1.0, output_mm=0.25).route(4.0)
    steps = steps_of(path)
    assert [step.index for step in steps] == list(range(1, len(steps) + 1))
    assert sum(step.dt_s for step in steps) == pytest.approx(0.1)
    assert steps[-1].clock_s == pytest.approx(0.1) and steps[-1].fraction == pytest.approx(1.0)
    ends = [step.index for step in steps if step.ends_piece]
    assert ends == [len(of(steps, "press")), len(steps)]
    assert all(step.indenting == (step.phase == "press") for step in steps)
    assert all(step.output for step in of(steps, "press"))  # it asks for none
    outputs = [step.displacement_mm for step in of(steps, "slide") if step.output]
    assert outputs == pytest.approx([0.25, 0.5, 0.75, 1.0])
    places = np.array([step.stimulator_mm for step in steps])
    across, up = np.diff(places[:, 1]), np.diff(places[:, 2], prepend=0.0)
    assert np.abs(across).max() <= 0.2 + 1e-12 and up.max() <= 0.2 + 1e-12
    np.testing.assert_array_equal(places[-1], [0.0, -1.0, 1.0])


def test_presses_go_on_from_force_to_force():
    forces = 0.1, 0.2, 0.4
    pieces = tuple(Press(force_N=force) for force in forces)
    steps = steps_of(Protocol(path=pieces).route(3.0))
    ends = [step for step in steps if step.ends_piece]
    assert [step.load.force_N[2] for step in ends] == pytest.approx(forces, rel=1e-3)
    assert [step.depth_mm for step in ends] == pytest.approx(np.power(forces, 2 / 3), rel=1e-3)
    assert all(step.indenting for step in steps)


def test_a_held_force_is_held():
    problem = Spring()
    steps = list(Stepper(problem, TO_FORCE, SOLVER))
    assert list(dict.fromkeys(step.phase for step in steps)) == ["press", "hold", "slide", "lift"]
    reached = of(steps, "press")[-1]
    assert reached.load.force_N[2] == pytest.approx(0.4, rel=1e-3)
    assert reached.depth_mm == pytest.approx(0.4 ** (2 / 3), rel=1e-3)
    for step in of(steps, "hold") + of(steps, "slide"):
        assert step.load.force_N[2] == pytest.approx(0.4, rel=1e-3)
    slid = of(steps, "slide")
    assert slid[-1].depth_mm == pytest.approx(0.48 ** (2 / 3), rel=1e-3)
    assert slid[-1].displacement_mm == pytest.approx(1.0)
    np.testing.assert_allclose(steps[-1].stimulator_mm, [0.0, -1.0, -0.1], atol=1e-12)
    assert not steps[-1].load.force_N.any()
    # What overshoots the force is work as well.
    assert sum(step.solves for step in steps) == len(problem.solves) > len(steps)
    assert sum(step.newton_iterations for step in steps) == 3 * len(problem.solves)
    assert sum(step.linear_iterations for step in steps) == 9 * len(problem.solves)
    # Where the secant has the spring's stiffness, most steps take one solve, few more than two.
    assert np.mean([step.solves for step in slid]) < 2


def test_what_is_interrupted_goes_on_the_same():
    whole = steps_of(TO_FORCE)
    for cut in (1, len(of(whole, "press")), len(of(whole, "press")) + 3, len(whole) - 1):
        stepper = Stepper(Spring(), TO_FORCE, SOLVER)
        taken = list(islice(stepper, cut))
        assert taken[-1].index == cut
        saved = gathered(stepper.to_save())
        stepper = Stepper(Spring(), TO_FORCE, SOLVER)
        stepper.restore(saved)
        rest = list(stepper)
        assert [step.index for step in rest] == list(range(cut + 1, len(whole) + 1))
        for name in ("clock_s", "displacement_mm", "fraction", "output", "ends_piece", "phase"):
            assert [getattr(s, name) for s in rest] == [getattr(s, name) for s in whole[cut:]]
        places = [[s.stimulator_mm for s in each] for each in (rest, whole[cut:])]
        np.testing.assert_array_equal(*places)


def test_a_force_that_is_there_already_ends_the_press(monkeypatch, caplog):
    monkeypatch.setattr(logging.getLogger("tactile_fem"), "propagate", True)
    path = Path((press(0.8), press(3.0, until_N=0.4), Lift(depth_mm=0.0)))
    with caplog.at_level(logging.INFO, "tactile_fem"):
        steps = steps_of(path)
    deepest = max(step.depth_mm for step in steps)
    assert deepest == 0.8 and steps[-1].depth_mm == 0.0
    assert len(of(steps, "press")) == [step.ends_piece for step in steps].index(True) + 1
    assert f"{0.8**1.5:.4f} N are reached at a depth of 0.8000 mm" in caplog.text


def test_a_force_that_is_not_reached_stops_where_the_press_ends():
    where = r"the press stopped at a depth of 0\.5000 mm"
    with pytest.raises(ConvergenceError, match=where) as error:
        steps_of(Path((press(0.5, until_N=0.4),)))
    assert "the force is not reached" in str(error.value)
    assert error.value.stimulator_mm == (0.0, 0.0, 0.5)


def test_a_force_that_cannot_be_held_stops_the_slide(monkeypatch):
    """The spring gives way: past 0.5 mm there is nothing."""
    load = Spring.load

    def gone(problem):
        found = load(problem)
        if problem.state.translation.value[1] < -0.5:
            found.force_N[:] = 0.0
        return found

    monkeypatch.setattr(Spring, "load", gone)
    with pytest.raises(ConvergenceError, match=r"the slide stopped .* force is not met") as error:
        steps_of(TO_FORCE)
    assert -0.5 <= error.value.stimulator_mm[1] < -0.49


def test_a_path_of_ones_own_is_stepped_within_its_bounds():
    def place(t):
        return np.array([np.sin(t), 1 - np.cos(t), 0.0])

    circle = Path((lambda start: Motion("circle", 2 * np.pi, place, (1.0, 4.0)),))
    steps = steps_of(circle)
    assert all(step.indenting is False for step in steps)
    assert [step.clock_s for step in steps if step.output] == pytest.approx([1, 4, 2 * np.pi])
    assert max(step.dt_s for step in steps) <= 0.2 * (1 + 1e-5)  # at 1 mm/s
    assert steps[-1].displacement_mm == pytest.approx(2 * np.pi, rel=1e-5)


def test_a_hold_begins_with_steps_as_brief_as_the_last():
    """What relaxes does so as fast as the press went."""
    steps = steps_of(Path((press(0.5), Hold(time_s=1.0, output_s=1.0))))
    pressed, held = (of(steps, phase) for phase in ("press", "hold"))
    assert held[0].dt_s <= pressed[-1].dt_s * (1 + 1e-9)
    assert held[-1].dt_s > 10 * held[0].dt_s
    assert len({step.displacement_mm for step in steps}) == 1


@pytest.mark.parametrize(("speed", "briefest"), [(200.0, 0.01), (20.0, 0.01), (2.0, 0.001)])
def test_a_slow_motion_may_step_as_briefly_as_a_fast_one(speed, briefest, monkeypatch):
    """Viscosity, which holds what snaps, acts over a time."""
    problem = Spring()
    failed = SolveReport(False, 1, 1, 1.0, "always")
    monkeypatch.setattr(
        Spring, "solve", lambda p, place, dt, R, swing: p.solves.append(dt) or failed
    )
    path = Protocol(press_speed_mm_s=speed).route(1.0)
    stepper = Stepper(problem, path, Solver(min_step_mm=0.01))
    with pytest.raises(ConvergenceError, match=r"try .*, a smoother stimulus, less"):
        list(stepper)
    assert briefest <= speed * min(problem.solves) < 2 * briefest


class Countable(Spring):
    """A spring with another law of force, whose solves are counted."""

    def __init__(self, law) -> None:
        super().__init__()
        self._law = law

    def solve(self, place: np.ndarray, dt_s: float, rotation: np.ndarray, swing) -> SolveReport:
        assert len(self.solves) < 300, "it goes on for ever"
        return super().solve(place, dt_s, rotation, swing)

    def load(self) -> Load:
        z, dt_s = self.state.translation.value[-1], self.state.dt_s
        force = np.array([0.0, 0.0, self._law(z, dt_s)])
        return Load(force, *3 * [np.zeros(3)], *8 * [0.0], *3 * [np.zeros((0, 3))])


def test_a_press_ends_at_a_force_that_short_steps_pass_at_once():
    """As with tissue that relaxes: the shorter the step, the stiffer is the contact."""
    problem = Countable(lambda z, dt: max(z, 0.0) ** 1.5 * (1 + 0.05 / (1 + dt / 1e-3)))
    steps = list(Stepper(problem, Path((press(3.0, until_N=0.4),)), SOLVER))
    assert steps[-1].load.force_N[2] == pytest.approx(0.4, rel=1e-3)
    assert len(problem.solves) < len(steps) + 12


@pytest.mark.parametrize("held", [False, True])
def test_a_force_that_jumps_ends_in_a_sentence(held, caplog, monkeypatch):
    monkeypatch.setattr(logging.getLogger("tactile_fem"), "propagate", True)
    problem = Countable(lambda z, dt: max(z, 0.0) if z < 0.5 else 1.0)
    piece = Hold(time_s=0.1, output_s=0.05, force_N=0.7) if held else press(3.0, until_N=0.7)
    with caplog.at_level(logging.INFO, "tactile_fem"), pytest.raises(ConvergenceError) as error:
        list(Stepper(problem, Path((press(0.4), piece)), SOLVER))
    where = r"the force is not met: it jumps within (\S+) mm at a depth of (\S+) mm"
    ((width, at),) = re.findall(where, str(error.value))
    assert float(at) == pytest.approx(0.5, abs=float(width) + 1e-4) and float(width) < 0.001
    assert len(problem.solves) < 150
    assert "of 0.7 N" in caplog.text


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_load_that_is_not_finite_is_not_accepted(value):
    problem = Countable(lambda z, dt: z if z < 0.5 else value)
    stepper = Stepper(problem, Path((press(1.0),)), SOLVER)
    steps = []
    with pytest.raises(ConvergenceError, match="the load is not finite"):
        steps.extend(stepper)
    assert problem.state.translation_old.value[-1] < 0.5
