"""Steps the finger problem along the path of the body."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from tactile_fem.errors import ConvergenceError
from tactile_fem.finger.plane import SPACE, Plane
from tactile_fem.mechanics.load import Load
from tactile_fem.mechanics.rows import Saved
from tactile_fem.path import HeldLoads, Motion, Path
from tactile_fem.path.loads import NORMAL, NOTHING
from tactile_fem.path.rotations import matrix, vector
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.control import TOLERANCE, StepControl, StepTooSmallError
from tactile_fem.simulation.equilibrium import Equilibrium, Solved
from tactile_fem.simulation.held import SCALES, Held
from tactile_fem.simulation.pose import Pose
from tactile_fem.simulation.step import Step
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.report import SolveReport
from tactile_fem.study import Solver

logger = logging.getLogger(__name__)

# Least share of a step that passes a force at which the force is sought.
_MIN_SHARE = 0.05
# A step that holds loads takes more iterations, be it short or long.
_EASY_AT_LOADS = 16
# At this speed or faster a step may not be shorter than `min_step_mm`.
_FULL_SPEED_MM_S = 20.0


@dataclass
class _Progress:
    """Position along the path, in plain numbers."""

    piece: int  # index of the piece of the path
    start_mm: tuple[float, float, float]  # position of the body when it began
    start_rad: tuple[float, float, float]  # its rotation vector then
    start_load: tuple[float, ...]  # on the finger then; see `HeldLoads`
    start_s: float  # time when it began
    slid_mm: float  # length of the path across the finger when it began
    indenting: bool  # whether the steps so far belong to the indentation
    index: int  # number of accepted steps
    control: StepControl  # of the steps along the piece


class Stepper:
    """The path as a sequence of accepted steps; a step that fails is halved.

    The problem of a section knows the two axes of its plane only; the path and the steps have
    three.
    """

    def __init__(
        self,
        problem: FingerProblem,
        path: Path,
        settings: Solver,
        plane: Plane = SPACE,
        smoother_by: Sequence[str] = (),
        bone: Bone | None = None,
    ) -> None:
        self._problem, self._state, self._plane = problem, problem.state, plane
        self._path, self._settings, self._smoother_by = path, settings, smoother_by
        self._equilibrium = Equilibrium(problem, plane, settings.max_press_step_mm, bone)
        longest = settings.max_slide_step_mm, settings.max_press_step_mm
        self._weights = [motion.least_steps(*longest) for _, motion in path.plan()]
        rotation = plane.rotation(matrix(path.start_rad))
        self._state.place(plane.within(path.start_mm), rotation)
        self._progress = self._begin(0, start_s=0.0, slid_mm=0.0, indenting=True, index=0)

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
                if self._progress.piece == len(self._path.pieces) - 1:
                    return
                self._begin_next()
            step = self._try_step(started)
            if step is not None:
                yield step
                started = time.perf_counter()

    def load(self) -> Load:
        """Return the load at the end of the last accepted step, in space."""
        with self._problem.reopened():
            return self._equilibrium.in_space(self._problem.load())

    @property
    def bone_rad(self) -> float:
        """Angle of the bone about its joint; 0 if it is clamped."""
        return self._equilibrium.angle_rad

    def to_save(self) -> Saved:
        """Return all that the next step needs, as `State.to_save` does."""
        p = self._progress
        known = replace(p, control=replace(p.control, outputs_s=()))  # which are the path's
        loads, equilibrium = self._equilibrium.loads_before_N, self._equilibrium
        values = asdict(known) | {
            "stiffness_N_mm": equilibrium.stiffness_N_mm.tolist(),
            "loads_before_N": None if loads is None else loads.tolist(),
            "bone": equilibrium.bone.to_save() if equilibrium.bone else {},
        }
        return {**self._problem.to_save(), "progress": np.array(json.dumps(values))}

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Go on from where `to_save` was called, with what was gathered; all ranks call."""
        values = json.loads(str(saved["progress"]))
        control, loads = StepControl(**values.pop("control")), values.pop("loads_before_N")
        self._equilibrium.stiffness_N_mm = np.array(values.pop("stiffness_N_mm"))
        self._equilibrium.loads_before_N = None if loads is None else np.array(loads)
        if own := values.pop("bone"):
            assert self._equilibrium.bone is not None
            self._equilibrium.bone = replace(self._equilibrium.bone, **own)
        self._motion = self._path.pieces[values["piece"]](np.array(values["start_mm"]))
        control.outputs_s = tuple(self._motion.outputs_s)
        self._progress = _Progress(**values, control=control)
        self._problem.restore(saved)

    # --- pieces of the path --------------------------------------------------------------------

    def _begin_next(self) -> None:
        p = self._progress
        self._warn_without_contact()
        self._progress = self._begin(
            p.piece + 1,
            start_s=p.start_s + p.control.time_s,
            slid_mm=p.slid_mm + self._slid_mm(),
            indenting=p.indenting,
            index=p.index,
        )
        self._state.dt_old_s = 0.0  # nothing to extrapolate

    def _begin(
        self, piece: int, *, start_s: float, slid_mm: float, indenting: bool, index: int
    ) -> _Progress:
        start = self._equilibrium.pose()
        self._motion = self._path.pieces[piece](start.translation)
        control = self._control(self._motion)
        self._end_at_force(control)
        return _Progress(
            piece,
            tuple(start.translation.tolist()),
            tuple(vector(start.rotation).tolist()),
            tuple((self._equilibrium.loads_N() / SCALES).tolist()),
            start_s,
            slid_mm,
            indenting and self._motion.indents,
            index,
            control,
        )

    def _control(self, motion: Motion) -> StepControl:
        """Return the control of the steps of a motion.

        Where skin snaps, only viscosity over a short time step holds it. The smallest step of a
        slow motion is therefore as short in time as that of a fast one.
        """
        s = self._settings
        first = motion.time_within(0.0, s.first_slide_step_mm, s.first_step_mm)
        if motion.fastest_mm_s == 0.0 and self._state.dt_old_s:
            first = min(first, self._state.dt_old_s)
        smallest = s.min_step_mm / max(motion.fastest_mm_s, _FULL_SPEED_MM_S)
        easy = _EASY_AT_LOADS if motion.held else StepControl.easy_iterations
        outputs = tuple(motion.outputs_s)
        return StepControl(motion.duration_s, first, smallest, outputs, easy_iterations=easy)

    def _slid_mm(self) -> float:
        """Return the length of the piece across the finger so far."""
        return self._motion.slid_mm(self._progress.control.time_s)

    def _position_mm(self) -> np.ndarray:
        """Return where the body is after the last accepted step, (3,)."""
        return self._equilibrium.pose().translation

    def _pose(self, time_s: float) -> Pose:
        """Return the pose of the body by the path at a time in the present piece."""
        motion, rotation = self._motion, matrix(self._progress.start_rad)
        if motion.turn is not None:
            rotation = matrix(motion.turn(time_s)) @ rotation
        return Pose(motion.place(time_s), rotation)

    # --- one step ------------------------------------------------------------------------------

    def _try_step(self, started: float) -> Step | None:
        """Solve for the next position; return the accepted step, or None if it was rejected."""
        s, control, motion = self._settings, self._progress.control, self._motion
        equilibrium, until_N = self._equilibrium, motion.until_N
        longest = motion.time_within(control.time_s, s.max_slide_step_mm, s.max_press_step_mm)
        target = control.target_s(longest)
        dt = target - control.time_s
        equilibrium.predict(dt, holds=motion.held is not None)
        report, load = self._solve(motion.held or NOTHING, target)
        if load and until_N is not None and self._normal_N(load) > until_N * (1 + TOLERANCE):
            target, report, load = self._solve_press_end(target, load, report, until_N)
            dt = target - control.time_s
        if load is None:
            self._halve(target, report)
            return None
        if motion.held is None:
            equilibrium.note_stiffness(load)
        solves = equilibrium.accept(load, report)
        control.accept(target, report.iterations)
        self._end_at_force(control)
        return self._step(load, solves, dt, started)

    def _solve(self, loads: HeldLoads, target_s: float) -> Solved:
        """Solve for a time in the present piece, with the loads that are held."""
        progress, equilibrium = self._progress, self._equilibrium
        begin_s = progress.control.time_s
        wanted = loads.at(target_s, np.array(progress.start_load))
        pose, dt_s = self._pose(target_s), target_s - begin_s
        held = Held(loads.components, wanted, pose, equilibrium.bone, dt_s)
        return equilibrium.solve(held, self._pose(begin_s), self._motion.phase)

    def _normal_N(self, load: Load) -> float:
        """Return the normal force of the last solve."""
        return float(self._equilibrium.in_space(load).force_N[NORMAL])

    def _step(
        self, load: Load, solves: tuple[SolveReport, ...], dt_s: float, started: float
    ) -> Step:
        """Return the step that was accepted."""
        progress, pose = self._progress, self._equilibrium.pose()
        progress.index += 1
        return Step(
            **vars(self._equilibrium.in_space(load)),
            index=progress.index,
            phase=self._motion.phase,
            indenting=progress.indenting,
            displacement_mm=progress.slid_mm + self._slid_mm(),
            dt_s=dt_s,
            clock_s=progress.start_s + progress.control.time_s,
            stimulator_mm=pose.translation,
            stimulator_rad=vector(pose.rotation),
            bone_rad=self._equilibrium.angle_rad,
            newton_iterations=sum(solve.iterations for solve in solves),
            linear_iterations=sum(solve.linear_iterations for solve in solves),
            discarded=solves[:-1],
            output=progress.control.at_output,
            ends_piece=progress.control.finished,
            fraction=self._fraction(),
            wall_s=time.perf_counter() - started,
            force_unit=self._plane.force_unit,
        )

    def _fraction(self) -> float:
        progress = self._progress
        done = sum(self._weights[: progress.piece])
        share = progress.control.time_s / progress.control.end_s
        return (done + share * self._weights[progress.piece]) / sum(self._weights)

    def _halve(self, target_s: float, report: SolveReport) -> None:
        self._equilibrium.discarded.append(report)
        self._state.reset()
        logger.info(
            "%s to %.5f s failed after %d iterations (%s): step halved",
            *(self._motion.phase, target_s, report.iterations, report.reason),
        )
        try:
            self._progress.control.reject(target_s)
        except StepTooSmallError:
            raise self._failure(report.reason) from None

    def _failure(self, reason: str) -> ConvergenceError:
        smoother = [f"a larger stimulus.{key}" for key in self._smoother_by]
        return stopped(
            self._motion.phase,
            self._position_mm(),
            self._progress.slid_mm + self._slid_mm(),
            reason,
            ", ".join(["a finer mesh", *smoother, "less friction"]) + " or a longer "
            "tissue.viscous_time_s",
        )

    # --- a press to a force ----------------------------------------------------------------------

    def _solve_press_end(
        self, target_s: float, load: Load, report: SolveReport, force_N: float
    ) -> tuple[float, SolveReport, Load | None]:
        """Find the end of a press that a step to `target_s` with that load has passed.

        The time is that at which the force, if linear over the step, is reached. The height is
        then sought at this duration: over shorter and shorter steps the force need not approach
        that of the last step, because relaxing tissues are stiffer in them, and the contact with
        them.
        """
        equilibrium, begin_s = self._equilibrium, self._progress.control.time_s
        equilibrium.discarded.append(report)
        before, passed = self._last_normal_N(), self._normal_N(load)
        share = max((force_N - before) / (passed - before), _MIN_SHARE)
        end_s = begin_s + share * (target_s - begin_s)
        equilibrium.note_stiffness(load)
        equilibrium.predict(end_s - begin_s)
        return end_s, *self._solve(HeldLoads.normal(force_N), end_s)

    def _end_at_force(self, control: StepControl) -> None:
        """End a press where its force is reached, which it may be from the start."""
        until_N = self._motion.until_N
        if until_N is not None and not self._is_short_of(until_N):
            control.end_s = control.time_s

    def _is_short_of(self, force_N: float) -> bool:
        """Return whether the normal force of the last accepted step is less."""
        return self._last_normal_N() < force_N * (1 - TOLERANCE)

    def _last_normal_N(self) -> float:
        """Return the normal force after the last accepted step."""
        return float(self._equilibrium.loads_N()[NORMAL])

    def _check_force_reached(self) -> None:
        """Log the force that a press has reached; raise ConvergenceError if it is too small."""
        if self._motion.until_N is None:
            return
        if self._is_short_of(self._motion.until_N):
            reached, wanted = self._last_normal_N(), self._motion.until_N
            raise stopped(
                self._motion.phase,
                self._position_mm(),
                self._progress.slid_mm + self._slid_mm(),
                f"the force is not reached: {reached:.3g} of {wanted:.3g} {self._plane.force_unit} "
                "at the deepest position that is allowed",
                "a smaller force",
            )
        logger.info(
            "%.4f %s are reached at a depth of %.4f mm",
            self._last_normal_N(),
            self._plane.force_unit,
            self._position_mm()[NORMAL],
        )

    def _warn_without_contact(self) -> None:
        """Warn if the indentation ends without contact."""
        if self._progress.indenting and not self._last_normal_N():
            logger.warning(
                "the press ends at %.4g mm without contact: no raised part of the stimulator lies "
                "under the pad, or the depth is too small",
                self._position_mm()[NORMAL],
            )


def stopped(
    phase: str, stimulator_mm: np.ndarray, slid_mm: float, reason: str, advice: str
) -> ConvergenceError:
    """Return the error of a path that goes no further, at the last accepted position."""
    return ConvergenceError(
        f"the {phase} stopped at a depth of {stimulator_mm[2]:.4f} mm, {slid_mm:.4f} mm across "
        f"({reason}); try {advice}",
        stimulator_mm,
        reason,
    )
