"""Steps the finger problem along the path of the body."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tactile_fem.errors import ConvergenceError
from tactile_fem.finger.plane import SPACE, Plane
from tactile_fem.mechanics.force_search import TOLERANCE, ForceSearch
from tactile_fem.mechanics.load import Load
from tactile_fem.mechanics.newton import SolveReport
from tactile_fem.mechanics.problem import FingerProblem
from tactile_fem.mechanics.state import Progress
from tactile_fem.mechanics.step_control import StepControl, StepTooSmallError
from tactile_fem.path import Motion, Path
from tactile_fem.study import Solver

logger = logging.getLogger(__name__)

# Least share of a step that passes a force at which the force is sought.
_LEAST_SHARE = 0.05
# Normal force over depth where nothing is known of it yet.
_FIRST_STIFFNESS_N_MM = 0.5
# At this speed or faster a step may not be shorter than `min_step_mm`.
_FAST_MM_S = 20.0
# Contact force and held reaction differ by what the residual's norm allows.
_BALANCE_N = 1e-5


@dataclass(frozen=True)
class Step(Load):
    """One accepted step: place of the body, load, and cost.

    What `trace.npz` holds of a step has the same name here, but for its `time_s`, which counts
    from the end of the indentation and is known only then.

    Attributes
    ----------
    index
        From 1 on.
    phase
        Name of the piece of the path.
    indenting
        Whether the step belongs to the indentation.
    displacement_mm
        Length of the path across the finger so far.
    depth_mm
        Of the body, Z of `stimulator_mm`.
    dt_s, clock_s
        Duration of the step; time since the start.
    stimulator_mm
        Place of the body relative to where it touches the undeformed pad's apex, (3,).
    newton_iterations, linear_iterations
        Of the step, solves that were discarded included.
    discarded
        Solves on the way to this step that failed or did not meet the wanted force.
    output, ends_piece
        Whether the path asked for output here; whether its piece ends here.
    fraction
        Share of the whole path's steps that is done.
    wall_s
        What the step took, discarded solves included.
    force_unit
        "N", in a section "N/mm" of its width; likewise "mm2" is mm and "mJ" mJ/mm there.
    """

    index: int
    phase: str
    indenting: bool
    displacement_mm: float
    depth_mm: float
    dt_s: float
    clock_s: float
    stimulator_mm: np.ndarray
    newton_iterations: int
    linear_iterations: int
    discarded: tuple[SolveReport, ...]
    output: bool
    ends_piece: bool
    fraction: float
    wall_s: float
    force_unit: str = "N"


class Stepper:
    """The path as a sequence of accepted steps.

    The problem of a section knows its plane's two axes only; the path and the steps have three.

    A step that fails is halved. The guess for a step extrapolates the last one of the same piece,
    which spares Newton about half its iterations.

    Parameters
    ----------
    problem
        The finger and the body.
    path
        Where the body goes.
    solver
        Bounds of the steps.
    plane
        That of a section.
    """

    def __init__(
        self, problem: FingerProblem, path: Path, solver: Solver, plane: Plane = SPACE
    ) -> None:
        self.problem, self._state = problem, problem.state
        self._plane = plane
        self._path, self._solver = path, solver
        longest = solver.max_slide_step_mm, solver.max_press_step_mm
        self._weights = [motion.least_steps(*longest) for _, motion in path.plan()]
        self._discarded: list[SolveReport] = []
        self._state.place(self._plane.within(path.start_mm))
        self._begin(0, start_s=0.0, slid_mm=0.0, indenting=True, index=0)

    def __iter__(self) -> Iterator[Step]:
        """Yield each accepted step until the path ends.

        Raises
        ------
        ConvergenceError
            If a step fails at the smallest size, or a force is not reached.
        """
        started = time.perf_counter()
        while True:
            while self._progress.control.finished:
                self._check_force_reached()
                if self.is_at_end:
                    return
                self._begin_next()
            step = self._try_step(started)
            if step is not None:
                yield step
                started = time.perf_counter()

    @property
    def is_at_end(self) -> bool:
        """Whether the last accepted step ends the path."""
        progress = self._progress
        return progress.control.finished and progress.piece == len(self._path.pieces) - 1

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Go back to the state that `State.gather` returned."""
        self.problem.restore(saved)
        progress = self._progress
        self._motion = self._path.pieces[progress.piece](np.array(progress.start_mm))
        progress.control.outputs_s = tuple(self._motion.outputs_s)

    @property
    def _progress(self) -> Progress:
        if self._state.progress is None:
            raise ValueError("the state was not saved on a path")
        return self._state.progress

    # --- pieces of the path --------------------------------------------------------------------

    def _begin_next(self) -> None:
        p = self._progress
        self._warn_without_contact()
        self._begin(
            p.piece + 1,
            start_s=p.start_s + p.control.time_s,
            slid_mm=p.slid_mm + self._slid_mm(),
            indenting=p.indenting,
            index=p.index,
        )
        self._progress.stiffness_N_mm = p.stiffness_N_mm
        self._state.dt_old_s = 0.0  # nothing to extrapolate

    def _begin(
        self, piece: int, *, start_s: float, slid_mm: float, indenting: bool, index: int
    ) -> None:
        start = self._place_mm()
        self._motion = self._path.pieces[piece](start)
        control = self._control(self._motion)
        indenting = indenting and self._motion.indents
        self._state.progress = Progress(
            piece, tuple(start.tolist()), start_s, slid_mm, indenting, index, control
        )
        self._end_at_force()

    def _control(self, motion: Motion) -> StepControl:
        """Return the control of the steps of a motion.

        Where skin snaps, only viscosity over a short time step holds it. The smallest step of a
        slow motion is therefore as short in time as that of a fast one.
        """
        s = self._solver
        first = motion.time_within(0.0, s.first_slide_step_mm, s.first_step_mm)
        if motion.fastest_mm_s == 0.0 and self._state.dt_old_s:
            first = min(first, self._state.dt_old_s)
        smallest = s.min_step_mm / max(motion.fastest_mm_s, _FAST_MM_S)
        return StepControl(motion.duration_s, first, smallest, tuple(motion.outputs_s))

    def _slid_mm(self) -> float:
        """Return the length of the piece across the finger so far."""
        return self._motion.slid_mm(self._progress.control.time_s)

    def _check_force_reached(self) -> None:
        """Log the force that a press has reached; raise ConvergenceError if it is too small."""
        if self._motion.until_N is None:
            return
        if self._short_of(self._motion.until_N):
            raise self._failure("the force is not reached at the deepest position")
        logger.info(
            "%.4f %s are reached at a depth of %.4f mm",
            self._state.force_old_N[-1],
            self._plane.force_unit,
            self._state.translation_old.value[-1],
        )

    def _warn_without_contact(self) -> None:
        """Warn if the indentation ends without contact."""
        if self._progress.indenting and not self._state.force_old_N[-1]:
            logger.warning(
                "the press ends at %.4g mm without contact: no raised part of the stimulator lies "
                "under the pad, or the depth is too small",
                self._state.translation_old.value[-1],
            )

    # --- one step ------------------------------------------------------------------------------

    def _try_step(self, started: float) -> Step | None:
        """Solve for the next place; return the accepted step, or None if it was rejected."""
        s, control, motion = self._solver, self._progress.control, self._motion
        longest = motion.time_within(control.time_s, s.max_slide_step_mm, s.max_press_step_mm)
        target = control.target_s(longest)
        dt = target - control.time_s
        self._predict(dt)
        place = self._plane.within(motion.place(target))
        if motion.held_N is None:
            report, load = self._solve(place, dt)
        else:
            report, load = self._solve_at_force(place, dt, motion.held_N, self._goes_on_to_mm(dt))
        if load is not None and motion.until_N is not None and _exceeds(load, motion.until_N):
            target, report, load = self._solve_press_end(target, load, report, motion.until_N)
            dt = target - control.time_s
        if load is None:
            self._cut(target, report)
            return None
        _check_balance(load, self._plane.force_unit)
        self._note_stiffness(load)
        self.problem.accept(load)
        control.accept(target, report.iterations)
        self._end_at_force()
        return self._step(load, report, dt, started)

    def _solve(self, place: np.ndarray, dt_s: float) -> tuple[SolveReport, Load | None]:
        """Find the equilibrium; return how that ended and the load, None if there is none."""
        report = self.problem.solve(place, dt_s)
        load = self.problem.load() if report.converged else None
        if load is not None and not load.is_finite:
            return replace(report, converged=False, reason="the load is not finite"), None
        return report, load

    def _step(self, load: Load, report: SolveReport, dt_s: float, started: float) -> Step:
        """Return the step that was accepted."""
        progress = self._progress
        progress.index += 1
        solves = (*self._discarded, report)
        discarded, self._discarded = tuple(self._discarded), []
        place, plane = self._place_mm(), self._plane
        force, moment = plane.vectors(load.force_N), plane.moment(load.moment_Nmm)
        return Step(
            **vars(replace(load, force_N=force, moment_Nmm=moment)),
            index=progress.index,
            phase=self._motion.phase,
            indenting=progress.indenting,
            displacement_mm=progress.slid_mm + self._slid_mm(),
            depth_mm=float(place[2]),
            dt_s=dt_s,
            clock_s=progress.start_s + progress.control.time_s,
            stimulator_mm=place,
            newton_iterations=sum(solve.iterations for solve in solves),
            linear_iterations=sum(solve.linear_iterations for solve in solves),
            discarded=discarded,
            output=progress.control.at_output,
            ends_piece=progress.control.finished,
            fraction=self._fraction(),
            wall_s=time.perf_counter() - started,
            force_unit=plane.force_unit,
        )

    def _place_mm(self) -> np.ndarray:
        """Return where the body is after the last accepted step, (3,)."""
        return self._plane.vectors(self._state.translation_old.value)

    def _predict(self, dt_s: float) -> None:
        state = self._state
        state.reset()
        if state.dt_old_s:
            u, old, before = state.u.x.array, state.u_old.x.array, state.u_before.x.array
            u += (dt_s / state.dt_old_s) * (old - before)

    def _cut(self, target_s: float, report: SolveReport) -> None:
        self._discarded.append(report)
        self._state.reset()
        logger.info(
            "%s to %.5f s failed after %d iterations (%s): step halved",
            self._motion.phase,
            target_s,
            report.iterations,
            report.reason,
        )
        try:
            self._progress.control.reject(target_s)
        except StepTooSmallError:
            raise self._failure(report.reason) from None

    # --- forces --------------------------------------------------------------------------------

    def _goes_on_to_mm(self, dt_s: float) -> float:
        """Return the height of the body if it goes on as in the last step."""
        state = self._state
        z = state.translation_old.value[-1]
        if state.dt_old_s:
            z += (dt_s / state.dt_old_s) * (z - state.translation_before[-1])
        return float(z)

    def _solve_at_force(
        self, place: np.ndarray, dt_s: float, force_N: float, z_mm: float
    ) -> tuple[SolveReport, Load | None]:
        """Find the equilibrium at a normal force, with the body's X and Y as in `place`.

        Its height is sought from `z_mm` on, see `ForceSearch`.
        """
        stiffness = self._progress.stiffness_N_mm or _FIRST_STIFFNESS_N_MM
        search = ForceSearch(force_N, z_mm, stiffness, self._solver.max_press_step_mm)
        while True:
            z = search.z_mm
            report, load = self._solve(np.array([*place[:-1], z]), dt_s)
            if load is None:
                return report, None
            force = float(load.force_N[-1])
            if search.is_met(force):
                self._progress.stiffness_N_mm = search.stiffness_N_mm
                return report, load
            logger.log(
                logging.INFO if search.is_slow else logging.DEBUG,
                "%s: %.5g %s at %.5f mm, %.5g are sought",
                *(self._motion.phase, force, self._plane.force_unit, z, force_N),
            )
            if search.has_failed:
                return replace(report, converged=False, reason=search.reason), None
            self._discarded.append(report)

    def _solve_press_end(
        self, target_s: float, load: Load, report: SolveReport, force_N: float
    ) -> tuple[float, SolveReport, Load | None]:
        """Find the end of a press, which a step to `target_s` with that load has passed.

        The time is that at which the force, if linear over the step, is reached. The height is
        then sought at this duration: over shorter and shorter steps the force need not approach
        that of the last step, because relaxing tissues are stiffer in them, and the contact with
        them.
        """
        self._discarded.append(report)
        before, passed = float(self._state.force_old_N[-1]), float(load.force_N[-1])
        begin_s = self._progress.control.time_s
        share = max((force_N - before) / (passed - before), _LEAST_SHARE)
        end_s = begin_s + share * (target_s - begin_s)
        place = self._plane.within(self._motion.place(end_s))
        self._note_stiffness(load)
        self._predict(end_s - begin_s)
        found = self._solve_at_force(place, end_s - begin_s, force_N, float(place[-1]))
        return end_s, *found

    def _note_stiffness(self, load: Load) -> None:
        """Note how the normal force grew with the depth in a step towards the finger."""
        state = self._state
        gained = load.force_N[-1] - state.force_old_N[-1]
        deeper = state.translation.value[-1] - state.translation_old.value[-1]
        if self._motion.held_N is None and gained * deeper > 0:
            self._progress.stiffness_N_mm = float(gained / deeper)

    def _end_at_force(self) -> None:
        """End a press where its force is reached, which it may be from the start."""
        until_N, control = self._motion.until_N, self._progress.control
        if until_N is not None and not self._short_of(until_N):
            control.end_s = control.time_s

    def _short_of(self, force_N: float) -> bool:
        """Return whether the normal force of the last accepted step is less."""
        return bool(self._state.force_old_N[-1] < force_N * (1 - TOLERANCE))

    # --- reports -------------------------------------------------------------------------------

    def _fraction(self) -> float:
        progress = self._progress
        done = sum(self._weights[: progress.piece])
        share = progress.control.time_s / progress.control.end_s
        return (done + share * self._weights[progress.piece]) / sum(self._weights)

    def _failure(self, reason: str) -> ConvergenceError:
        progress = self._progress
        return stopped(
            self._motion.phase,
            self._place_mm(),
            progress.slid_mm + self._slid_mm(),
            reason,
            "a finer mesh, rounder edges, less friction or a longer tissue.viscous_time_s",
        )


def stopped(
    phase: str, stimulator_mm: np.ndarray, slid_mm: float, reason: str, advice: str
) -> ConvergenceError:
    """Return the error of a path that goes no further, at the last accepted place."""
    return ConvergenceError(
        f"the {phase} stopped at a depth of {stimulator_mm[2]:.4f} mm, {slid_mm:.4f} mm across "
        f"({reason}); try {advice}",
        stimulator_mm,
        reason,
    )


def _exceeds(load: Load, force_N: float) -> bool:
    """Return whether a load has passed a normal force."""
    return bool(load.force_N[-1] > force_N * (1 + TOLERANCE))


def _check_balance(load: Load, unit: str) -> None:
    """Warn if contact force and reaction of the fixed parts differ."""
    if not load.imbalance_N <= _BALANCE_N:
        logger.warning(
            "contact force and held reaction differ by %.1e %s: the step is not in equilibrium",
            load.imbalance_N,
            unit,
        )
