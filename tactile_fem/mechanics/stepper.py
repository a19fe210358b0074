"""Steps the finger problem through the protocol: press, then slide."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tactile_fem.errors import ConvergenceError
from tactile_fem.mechanics.problem import FingerProblem, Load, SolveReport
from tactile_fem.mechanics.step_control import StepControl, StepTooSmallError
from tactile_fem.study import Protocol, Solver

logger = logging.getLogger(__name__)

Phase = Literal["press", "slide"]
_FORCE_TOLERANCE = 1e-3
# At this speed or faster a step may not be shorter than `min_step_mm`.
_FAST_MM_S = 20.0
# Contact force and held reaction differ by what the residual's norm allows.
_BALANCE_N = 1e-5
_UP = np.array([0.0, 0.0, 1.0])
_PROXIMAL = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Step(Load):
    """One accepted step: where the body is, the load, and what finding it cost.

    What `trace.npz` holds of a step has the same name here, but for its `time_s`, which counts
    from the end of the press and is known only then.

    Attributes
    ----------
    index
        From 1 on.
    phase
        "press" or "slide".
    displacement_mm, depth_mm
        Of the slide, 0 in the press; of the press, which the slide holds.
    size_mm
        How far the body moved.
    clock_s
        Time since the start of the indentation.
    stimulator_mm
        Place of the body relative to where it touches the undeformed pad's apex, (3,).
    newton_iterations, linear_iterations
        Of the step, solves that were discarded included.
    discarded
        Solves on the way to this step that failed or overshot the wanted force.
    milestone
        Whether the protocol asked for output here.
    fraction
        Share of the protocol's path that is done.
    wall_s
        What the step took, discarded solves included.
    """

    index: int
    phase: Phase
    displacement_mm: float
    depth_mm: float
    size_mm: float
    clock_s: float
    stimulator_mm: np.ndarray
    newton_iterations: int
    linear_iterations: int
    discarded: tuple[SolveReport, ...]
    milestone: bool
    fraction: float
    wall_s: float


class Stepper:
    """The protocol as a sequence of accepted steps; its state can be saved and restored.

    A step that fails is halved. The guess for a step extrapolates the last one of the same
    phase, which spares Newton about half its iterations.

    Parameters
    ----------
    problem
        The finger and the body.
    protocol, solver
        Depth or force, distance, speeds; bounds of the steps.
    deepest_mm
        Depth at which pressing to a force is given up.
    """

    def __init__(
        self, problem: FingerProblem, protocol: Protocol, solver: Solver, deepest_mm: float
    ) -> None:
        self.problem = problem
        self._protocol = protocol
        self._solver = solver
        self._phase: Phase = "press"
        depth = protocol.depth_mm if protocol.force_N is None else deepest_mm
        self._control = self._press_control(depth)
        self._depth = 0.0
        self._clock = 0.0
        self._index = 0
        self._stick_before = problem.stick.old.x.array.copy()
        self._last_step = 0.0
        self._iterations = 0
        self._discarded: list[SolveReport] = []

    def __iter__(self) -> Iterator[Step]:
        """Yield each accepted step until the protocol ends.

        Raises
        ------
        ConvergenceError
            If a step fails at the smallest size.
        """
        started = time.perf_counter()
        while True:
            if self._control.finished:
                if self._phase == "slide":
                    return
                if self._protocol.force_N is not None and self._short_of_force():
                    raise self._failure("the wanted force is not reached at the deepest press")
                self._tell_pressed()
                self._phase, self._control = "slide", self._slide_control()
                self._last_step = 0.0
                if self._control.finished:
                    return
            step = self._try_step(started)
            if step is not None:
                yield step
                started = time.perf_counter()

    def _press_control(self, depth: float) -> StepControl:
        s, smallest = self._solver, self._smallest(self._protocol.press_speed_mm_s)
        return StepControl(depth, s.first_step_mm, s.max_press_step_mm, smallest)

    def _slide_control(self) -> StepControl:
        s, p = self._solver, self._protocol
        smallest = self._smallest(p.speed_mm_s)
        count = int(p.distance_mm / p.output_mm + 1e-9)
        milestones = tuple(p.output_mm * np.arange(1, count + 1))
        return StepControl(
            p.distance_mm, s.first_slide_step_mm, s.max_slide_step_mm, smallest, milestones
        )

    def _smallest(self, speed_mm_s: float) -> float:
        """Return the length at which a failed step ends the scan.

        Where skin snaps, viscosity holds it within brief steps: a slow motion may step as briefly.
        """
        return self._solver.min_step_mm * min(1.0, speed_mm_s / _FAST_MM_S)

    def _try_step(self, started: float) -> Step | None:
        """Solve for the next position; return the accepted step, or None if it was cut."""
        control, problem = self._control, self.problem
        target = control.target_mm()
        size = target - control.position_mm
        pressing = self._phase == "press"
        p = self._protocol
        dt = size / self._speed_mm_s
        self._predict(size)
        report = problem.solve(self._translation(target), dt)
        if not report.converged:
            self._cut(target, report)
            return None
        load = problem.load()
        _check_balance(load)
        if pressing and p.force_N is not None and not self._fits_force(target, load, p.force_N):
            self._discarded.append(report)
            return None
        discarded, self._discarded = tuple(self._discarded), []
        self._stick_before[:] = problem.stick.old.x.array
        self._last_step = size
        self._iterations = report.iterations
        problem.accept()
        control.accept(target, report.iterations)
        self._clock += dt
        self._index += 1
        if pressing:
            self._depth = target
            if p.force_N is not None and not self._short_of_force():
                control.length_mm = target
        return Step(
            **vars(load),
            index=self._index,
            phase=self._phase,
            displacement_mm=0.0 if pressing else target,
            depth_mm=self._depth,
            size_mm=size,
            clock_s=self._clock,
            stimulator_mm=self._translation(target),
            newton_iterations=sum(r.iterations for r in (*discarded, report)),
            linear_iterations=sum(r.linear_iterations for r in (*discarded, report)),
            discarded=discarded,
            milestone=control.at_milestone,
            fraction=self._fraction(),
            wall_s=time.perf_counter() - started,
        )

    @property
    def _speed_mm_s(self) -> float:
        p = self._protocol
        return p.press_speed_mm_s if self._phase == "press" else p.speed_mm_s

    def _translation(self, position: float) -> np.ndarray:
        if self._phase == "press":
            return position * _UP
        return self._depth * _UP + position * _PROXIMAL

    def _predict(self, size: float) -> None:
        u, old = self.problem.u.x.array, self.problem.u_old.x.array
        u[:] = old
        if self._last_step:
            u += (size / self._last_step) * (old - self.problem.u_before.x.array)

    def _cut(self, target: float, report: SolveReport) -> None:
        self._discarded.append(report)
        self.problem.u.x.array[:] = self.problem.u_old.x.array
        logger.info(
            "%s to %.4f mm failed after %d iterations (%s): step halved",
            self._phase,
            target,
            report.iterations,
            report.reason,
        )
        try:
            self._control.reject(target)
        except StepTooSmallError:
            raise self._failure(report.reason) from None

    def _fits_force(self, target: float, load: Load, force: float) -> bool:
        """Accept a press that does not overshoot the force; else aim by the secant."""
        reached = float(load.force_N[2])
        if reached <= force * (1 + _FORCE_TOLERANCE):
            return True
        before = self._force_N
        share = (force - before) / (reached - before)
        step = max(share, 0.05) * (target - self._control.position_mm)
        self._control.step_mm = self._control.largest_mm = step
        return False

    @property
    def _force_N(self) -> float:
        """Normal force at the last accepted step."""
        return float(self.problem.load_cell.force_old_N[2])

    def _short_of_force(self) -> bool:
        force = self._protocol.force_N
        return force is not None and self._force_N < force * (1 - _FORCE_TOLERANCE)

    def _tell_pressed(self) -> None:
        """Say what the press has reached, if that was not asked for or is nothing."""
        if self._protocol.force_N is not None:
            logger.info(
                "%.4f N are reached at a depth of %.4f mm, which the slide holds",
                self._force_N,
                self._depth,
            )
        elif self._force_N == 0.0:
            logger.warning(
                "the press ends at %.4g mm without contact: no raised part of the stimulator lies "
                "under the pad, or the depth is too small",
                self._depth,
            )

    def _fraction(self) -> float:
        whole = self._control.length_mm if self._phase == "press" else self._depth
        done = self._depth + (self._control.position_mm if self._phase == "slide" else 0.0)
        return min(1.0, done / (whole + self._protocol.distance_mm))

    def _failure(self, reason: str) -> ConvergenceError:
        place = self._control.position_mm
        what = "indentation" if self._phase == "press" else "slide"
        return ConvergenceError(
            f"the {what} stopped at {place:.4f} mm ({reason}); everything up to there is kept; "
            "try a finer mesh, rounder edges, less friction or a longer tissue.viscous_time_s",
            place,
            reason,
        )

    def state(self) -> dict[str, Any]:
        """Return what is needed, besides the displacements, to go on from here."""
        c = self._control
        return {
            "phase": self._phase,
            "position_mm": c.position_mm,
            "length_mm": c.length_mm,
            "step_mm": c.step_mm,
            "largest_mm": c.largest_mm,
            "wait": c.wait,
            "depth_mm": self._depth,
            "clock_s": self._clock,
            "index": self._index,
            "force_N": self.problem.load_cell.force_old_N.tolist(),
            "last_step_mm": self._last_step,
            "iterations": self._iterations,
        }

    def restore(self, state: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `state` and `gather` returned."""
        self._phase = state["phase"]
        press = self._phase == "press"
        self._control = self._press_control(0.0) if press else self._slide_control()
        for name in ("position_mm", "length_mm", "step_mm", "largest_mm", "wait"):
            setattr(self._control, name, state[name])
        self._depth, self._clock = state["depth_mm"], state["clock_s"]
        self._index = state["index"]
        self._last_step, self._iterations = state["last_step_mm"], state["iterations"]
        self._back_to_last_step(arrays)
        order, problem = self.problem.order, self.problem
        here = self._translation(self._control.position_mm)
        if self._iterations:
            order.scatter(arrays["u_linear"], problem.u)
            problem.prepare(here, self._last_step / self._speed_mm_s)
        order.scatter(arrays["u"], problem.u)
        problem.place(here)
        problem.load_cell.force_old_N = np.array(state["force_N"])
        order.scatter(arrays["friction"], problem.load_cell.friction_old)
        problem.stick.scatter(arrays["unmatched_MPa"])

    def _back_to_last_step(self, arrays: dict[str, np.ndarray]) -> None:
        """Let `problem` stand where it stood before the last step."""
        problem, control = self.problem, self._control
        problem.order.scatter(arrays["u_before"], problem.u_before)
        problem.u.x.array[:] = problem.u_before.x.array
        problem.place(self._translation(control.position_mm - self._last_step))
        problem.stick.scatter(arrays["unmatched_before_MPa"])
        self._stick_before[:] = problem.stick.old.x.array

    def gather(self) -> dict[str, np.ndarray]:
        """Return the arrays of the state, independent of the number of ranks.

        Displacements now, `u`, a step before, `u_before`, and of the last Jacobian, `u_linear`,
        and nodal forces of `friction`, (n, 3) in the mesh file's node order; `unmatched_MPa` and
        `unmatched_before_MPa`, see `StickMemory.gather`.
        """
        problem = self.problem
        functions = {
            "u": problem.u,
            "u_before": problem.u_before,
            "u_linear": problem.u_linear,
            "friction": problem.load_cell.friction_old,
        }
        nodal = {name: problem.order.gather(function) for name, function in functions.items()}
        stick = problem.stick
        return {
            **nodal,
            "unmatched_MPa": stick.gather(stick.old.x.array),
            "unmatched_before_MPa": stick.gather(self._stick_before),
        }


def _check_balance(load: Load) -> None:
    """Warn if the contact force is not what the held parts carry."""
    if load.imbalance_N > _BALANCE_N:
        logger.warning(
            "contact force and held reaction differ by %.1e N: the step is not in equilibrium",
            load.imbalance_N,
        )
