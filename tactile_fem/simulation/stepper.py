"""Steps the finger problem along the path of the body."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_fem.errors import ConvergenceError
from tactile_fem.finger.plane import SPACE, Plane
from tactile_fem.mechanics.load import Load
from tactile_fem.mechanics.rows import Snapshot
from tactile_fem.path import HeldLoads, Motion, Path
from tactile_fem.path.loads import NORMAL, NOTHING
from tactile_fem.path.rotations import matrix, vector
from tactile_fem.simulation.balance import SCALES, LoadBalance
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.control import StepControl
from tactile_fem.simulation.equilibrium import Equilibrium
from tactile_fem.simulation.load_search import allowed_N
from tactile_fem.simulation.pose import Pose
from tactile_fem.simulation.step import Step
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.report import SolveReport
from tactile_fem.study import Solver

logger = logging.getLogger(__name__)

# Least share of a step that passes a force at which the force is sought.
_MIN_SHARE = 0.05
# A step that holds loads takes more iterations, be it short or long.
_TARGET_ITERATIONS_AT_LOADS = 16
# At this speed or faster a step may not be shorter than `min_step_mm`.
_FULL_SPEED_MM_S = 20.0


@dataclass
class _Progress:
    """Position along the path, in plain numbers."""

    piece: int = 0  # index of the piece of the path
    start_mm: Sequence[float] = ()  # position of the body when it began, (3,)
    start_rad: Sequence[float] = ()  # its rotation vector then, (3,)
    start_load: Sequence[float] = ()  # on the finger then, (4,); see `HeldLoads`
    start_s: float = 0.0  # time when it began
    slid_mm: float = 0.0  # length of the path across the finger when it began
    indenting: bool = True  # whether the steps so far belong to the indentation
    index: int = 0  # number of accepted steps


class Stepper:
    """The path as a sequence of accepted steps; a step that fails is cut back.

    The problem of a section knows the two axes of its plane only; the path and the steps have
    three.
    """

    def __init__(
        self,
        problem: FingerProblem,
        path: Path,
        settings: Solver,
        plane: Plane = SPACE,
        bone: Bone | None = None,
    ) -> None:
        self._problem, self._state, self._plane = problem, problem.state, plane
        self._path, self._settings = path, settings
        self._equilibrium = Equilibrium(problem, plane, settings.max_press_step_mm, bone)
        longest = settings.max_slide_step_mm, settings.max_press_step_mm
        self._weights = [motion.least_steps(*longest) for _, motion in path.plan()]
        rotation = plane.rotation(matrix(path.start_rad))
        self._state.place(plane.within(path.start_mm), rotation)
        self._progress = _Progress()
        self._begin(0)

    def __iter__(self) -> Iterator[Step]:
        """Yield each accepted step until the path ends.

        Raises
        ------
        ConvergenceError
            If a step fails at the smallest size, or a force is not reached.
        """
        started = time.perf_counter()
        while True:
            while self._control.finished:
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

    def to_save(self) -> Snapshot:
        """Return all that the next step needs, as `State.to_save` does."""
        values = vars(self._progress), self._control.to_save(), self._equilibrium.to_save()
        return {**self._problem.to_save(), "progress": np.array(json.dumps(values))}

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Go on from where `to_save` was called, with what was gathered; all ranks call."""
        progress, control, equilibrium = json.loads(str(saved["progress"]))
        self._progress = _Progress(**progress)
        self._motion = self._motion_from(progress["start_mm"])
        self._control = replace(self._step_control(), **control)
        self._equilibrium.restore(equilibrium)
        self._problem.restore(saved)

    # --- pieces of the path --------------------------------------------------------------------

    def _begin_next(self) -> None:
        """Begin the next piece of the path; warn if the indentation has ended without contact."""
        progress = self._progress
        if progress.indenting and not self._normal_old_N():
            logger.warning(
                "the press ends at %.4g mm without contact: no raised part of the stimulator lies "
                "under the pad, or the depth is too small",
                self._equilibrium.pose().translation[NORMAL],
            )
        progress.start_s += self._control.time_s
        progress.slid_mm += self._motion.slid_mm(self._control.time_s)
        self._begin(progress.piece + 1)

    def _begin(self, piece: int) -> None:
        """Begin a piece of the path where the body is."""
        progress, start = self._progress, self._equilibrium.pose()
        progress.piece, progress.start_mm = piece, start.translation.tolist()
        progress.start_rad = vector(start.rotation).tolist()
        progress.start_load = (self._equilibrium.loads_N() / SCALES).tolist()
        self._motion = self._motion_from(progress.start_mm)
        progress.indenting = progress.indenting and self._motion.indents
        self._control = self._step_control()
        self._end_at_force()
        self._state.dt_old_s = 0.0  # nothing to extrapolate

    def _motion_from(self, start_mm: Sequence[float]) -> Motion:
        return self._path.pieces[self._progress.piece](np.array(start_mm))

    def _step_control(self) -> StepControl:
        """Return the control of the steps along the present piece.

        Where skin snaps, only viscosity over a short time step holds it. The smallest step of a
        slow motion is therefore as short in time as that of a fast one.
        """
        s, motion = self._settings, self._motion
        first = motion.time_within(0.0, s.first_slide_step_mm, s.first_step_mm)
        if motion.fastest_mm_s == 0.0 and self._state.dt_old_s:
            first = min(first, self._state.dt_old_s)
        target = _TARGET_ITERATIONS_AT_LOADS if motion.held else StepControl.target_iterations
        return StepControl(
            end_s=motion.duration_s,
            step_s=first,
            min_step_s=s.min_step_mm / max(motion.fastest_mm_s, _FULL_SPEED_MM_S),
            max_step_s=lambda t: motion.time_within(t, s.max_slide_step_mm, s.max_press_step_mm),
            outputs_s=tuple(motion.outputs_s),
            target_iterations=target,
        )

    def _slid_mm(self) -> float:
        """Return the length of the path across the finger so far."""
        return self._progress.slid_mm + self._motion.slid_mm(self._control.time_s)

    def _pose(self, time_s: float) -> Pose:
        """Return the pose of the body by the path at a time in the present piece."""
        motion, rotation = self._motion, matrix(self._progress.start_rad)
        if motion.turn is not None:
            rotation = matrix(motion.turn(time_s)) @ rotation
        return Pose(motion.place(time_s), rotation)

    # --- one step ------------------------------------------------------------------------------

    def _try_step(self, started: float) -> Step | None:
        """Solve for the next position; return the accepted step, or None if it was rejected."""
        control, motion, equilibrium = self._control, self._motion, self._equilibrium
        begin_s, target = control.time_s, control.target_s
        load = self._solve(motion.held or NOTHING, target)
        if load and motion.until_N is not None:
            excess_N = self._normal_N(load) - motion.until_N
            if excess_N > allowed_N(motion.until_N):
                target = self._end_of_press_s(target, load, motion.until_N)
                load = self._solve(HeldLoads.normal(motion.until_N), target)
        if load is None:
            self._reject(target)
            return None
        if motion.held is None:
            equilibrium.note_stiffness(load)
        solves = equilibrium.accept(load)
        control.accept(target, solves[-1].iterations)
        self._end_at_force()
        return self._step(load, solves, target - begin_s, started)

    def _solve(self, loads: HeldLoads, target_s: float) -> Load | None:
        """Solve for a time in the present piece, with the loads that are held."""
        begin_s = self._control.time_s
        balance = LoadBalance(
            loads.components,
            loads.at(target_s, np.array(self._progress.start_load)),
            self._pose(target_s),
            self._equilibrium.bone,
            target_s - begin_s,
        )
        return self._equilibrium.solve(balance, self._pose(begin_s), self._motion.phase)

    def _normal_N(self, load: Load) -> float:
        """Return the normal force in space of the last solve, whose load this is."""
        return float(self._equilibrium.in_space(load).force_N[NORMAL])

    def _end_of_press_s(self, target_s: float, load: Load, force_N: float) -> float:
        """Return when a press ends whose step to `target_s`, with that load, exceeds the force.

        If the force were linear over the step, it would be reached then; the depth is sought for
        a step of this duration. Shorter and shorter steps need not bring the force closer to that
        of the last step, because relaxing tissues, and so the contact, are stiffer in them.
        """
        before, begin_s = self._normal_old_N(), self._control.time_s
        share = max((force_N - before) / (self._normal_N(load) - before), _MIN_SHARE)
        self._equilibrium.note_stiffness(load)
        return begin_s + share * (target_s - begin_s)

    def _step(self, load: Load, solves: Sequence[SolveReport], dt_s: float, started: float) -> Step:
        """Return the step that was accepted."""
        progress, pose = self._progress, self._equilibrium.pose()
        progress.index += 1
        return Step(
            load=self._equilibrium.in_space(load),
            index=progress.index,
            phase=self._motion.phase,
            indenting=progress.indenting,
            displacement_mm=self._slid_mm(),
            dt_s=dt_s,
            clock_s=progress.start_s + self._control.time_s,
            stimulator_mm=pose.translation,
            stimulator_rad=vector(pose.rotation),
            bone_rad=self._equilibrium.angle_rad,
            solves=len(solves),
            newton_iterations=sum(solve.iterations for solve in solves),
            linear_iterations=sum(solve.linear_iterations for solve in solves),
            output=self._control.at_output,
            ends_piece=self._control.finished,
            fraction=self._fraction(),
            wall_s=time.perf_counter() - started,
            force_unit=self._plane.force_unit,
        )

    def _fraction(self) -> float:
        progress = self._progress
        done = sum(self._weights[: progress.piece])
        share = self._control.time_s / self._control.end_s
        return (done + share * self._weights[progress.piece]) / sum(self._weights)

    def _reject(self, target_s: float) -> None:
        """Go back to the last accepted step and cut back; ConvergenceError if that is too short."""
        failed = self._equilibrium.solves[-1]
        self._state.reset()
        logger.info(
            "%s to %.5f s failed after %d iterations (%s): step halved",
            *(self._motion.phase, target_s, failed.iterations, failed.reason),
        )
        if not self._control.reject(target_s):
            advice = "a finer mesh, a smoother stimulus, less friction"
            raise self._stopped(failed.reason, f"{advice} or a longer tissue.viscous_time_s")

    def _stopped(self, reason: str, advice: str) -> ConvergenceError:
        """Return the error of a path that goes no further."""
        place = self._equilibrium.pose().translation
        return stopped(self._motion.phase, place, self._slid_mm(), reason, advice)

    # --- a press to a force ------------------------------------------------------------------

    def _end_at_force(self) -> None:
        """End a press where its force is reached, which it may be from the start."""
        if self._motion.until_N is not None and not self._is_short_of_force():
            self._control.finish()

    def _is_short_of_force(self) -> bool:
        """Return whether the last accepted step lacks some of the force that ends the press."""
        wanted_N = self._motion.until_N or 0.0
        return self._normal_old_N() < wanted_N - allowed_N(wanted_N)

    def _normal_old_N(self) -> float:
        """Return the normal force after the last accepted step."""
        return float(self._equilibrium.loads_N()[NORMAL])

    def _check_force_reached(self) -> None:
        """Log the force that a press has reached; raise ConvergenceError if it is too small."""
        reached, wanted, unit = self._normal_old_N(), self._motion.until_N, self._plane.force_unit
        if wanted is None:
            return
        if self._is_short_of_force():
            raise self._stopped(
                f"the force is not reached: {reached:.3g} of {wanted:.3g} {unit} "
                "at the deepest position that is allowed",
                "a smaller force",
            )
        depth_mm = self._equilibrium.pose().translation[NORMAL]
        logger.info("%.4f %s are reached at a depth of %.4f mm", reached, unit, depth_mm)


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
