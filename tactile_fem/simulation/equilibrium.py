"""The equilibrium with the body at a place, or at loads that it is moved to meet."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from tactile_fem.finger.plane import Plane
from tactile_fem.mechanics.load import Load
from tactile_fem.path.loads import NORMAL
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.control import ForceSearch
from tactile_fem.simulation.held import JOINT, SCALES, Held
from tactile_fem.simulation.load_search import LoadSearch, way_to
from tactile_fem.simulation.pose import Pose
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.report import SolveReport

Array = np.ndarray
logger = logging.getLogger(__name__)

# Loads over the body's motion along X, Y and Z, and its turn, before any is known.
_FIRST_STIFFNESS_N_MM = np.diag([0.3, 0.3, 0.5, 0.1, 0.7])
_FIRST_STIFFNESS_N_MM[[NORMAL, JOINT], [JOINT, NORMAL]] = 0.5
# A step that holds loads extrapolates the last one by at most this ratio of their durations.
_MOST_AT_LOADS = 2.0
# Share of the largest friction above which the skin is said to slip.
_SLIPS = 0.95
# How a solve ended and, if it succeeded, the load at its end.
Solved = tuple[SolveReport, Load | None]
# Unknowns of a search, and the displacement there.
Place = tuple[np.ndarray, np.ndarray]


class Equilibrium:
    """Solves for the end of a step; messages state forces in `force_unit`.

    In the search for loads two places of the body are at most `longest_mm` apart.
    """

    def __init__(
        self, problem: FingerProblem, plane: Plane, longest_mm: float, bone: Bone | None
    ) -> None:
        self._problem, self._plane, self._longest_mm = problem, plane, longest_mm
        # Solves of the present step that failed or did not meet the wanted loads.
        self.discarded: list[SolveReport] = []
        # Loads over the body's motion, as last observed.
        self.stiffness_N_mm = _FIRST_STIFFNESS_N_MM.copy()
        # Loads at the accepted step before the last one; None at the begin of a piece.
        self.loads_before_N: np.ndarray | None = None
        self.bone = bone
        self._angle_rad = 0.0  # of the bone, at the last solve

    def pose(self, *, before: bool = False) -> Pose:
        """Return where the body was after the last accepted step, or after that `before` it."""
        state, plane, bone = self._problem.state, self._plane, self.bone
        place, rotation = state.translation_old.value, state.rotation_old
        if before:
            place, rotation = state.translation_before, state.rotation_before
        pose = Pose(plane.vectors(place), plane.rotation_in_space(rotation))
        return bone.in_space(pose, bone.before_rad if before else bone.angle_rad) if bone else pose

    def loads_N(self) -> np.ndarray:
        """Return the loads after the last accepted step, scaled as `Held` does, (4,)."""
        state = self._problem.state
        load = self._in_space(state.force_old_N, state.moment_old_Nmm, self.angle_rad)
        return SCALES * self.pose().load(*load)

    @property
    def angle_rad(self) -> float:
        """Angle of the bone after the last accepted step; 0 if it is clamped."""
        return self.bone.angle_rad if self.bone else 0.0

    def in_space(self, load: Load) -> Load:
        """Return a load at the end of the last solve in space, with vectors (3,)."""
        force, moment = self._in_space(load.force_N, load.moment_Nmm, self._angle_rad)
        on_bone, about = self._in_space(load.bone_N, load.bone_Nmm, self._angle_rad)
        return replace(load, force_N=force, moment_Nmm=moment, bone_N=on_bone, bone_Nmm=about)

    def _in_space(self, force_N: Array, moment_Nmm: Array, angle_rad: float) -> tuple[Array, Array]:
        load = self._plane.vectors(force_N), self._plane.moment(moment_Nmm)
        return self.bone.load_in_space(*load, angle_rad) if self.bone else load

    def predict(self, dt_s: float, *, holds: bool = False) -> None:
        """Make the initial guess: extrapolate the last step, which halves the Newton iterations.

        If the step `holds` loads, by no more than twice as long.
        """
        state = self._problem.state
        state.reset()
        if state.dt_old_s:
            u, old, before = state.u.x.array, state.u_old.x.array, state.u_before.x.array
            u += self._ratio(dt_s, holds=holds) * (old - before)

    def _ratio(self, dt_s: float, *, holds: bool) -> float:
        """Return how much longer the step is than the last one, as far as it is extrapolated.

        Places that a search has found are as inaccurate as the loads.
        """
        ratio = dt_s / self._problem.state.dt_old_s
        return min(ratio, _MOST_AT_LOADS) if holds else ratio

    def at_pose(self, pose: Pose, dt_s: float, swing: Array | None = None) -> Solved:
        """Solve with the body at `pose`, after a `swing` of the bone."""
        place, rotation = self._plane.within(pose.translation), self._plane.rotation(pose.rotation)
        report = self._problem.solve(place, dt_s, rotation, swing)
        load = self._problem.load() if report.converged else None
        if load is not None and (reason := self._problem.rejection(load)):
            return replace(report, converged=False, reason=reason), None
        return report, load

    def solve(self, held: Held, path: Pose, phase: str) -> Solved:
        """Solve for the end of a step, with the loads that it holds.

        Parameters
        ----------
        held
            Loads, and where the body is at the end by the path.
        path
            Where it would have been by the path after the last step.
        phase
            Name of the piece of the path, for messages.
        """
        if not held.indices:
            return self.at_pose(held.pose, held.dt_s)
        if held.indices == [NORMAL]:
            return self._at_normal_force(held, path, phase)
        own = np.ix_(held.indices, held.indices)
        start = self._predicted(held, path)
        search = LoadSearch(start, self.stiffness_N_mm[own], self._longest_mm)
        last = self._unknowns(held, held.pose), self._problem.state.u_old.x.array.copy()
        while True:
            x, angle, pose = search.x, held.angle_rad(search.x), held.pose_at(search.x)
            seen = held.bone.seen_from(pose, angle) if held.bone else pose
            swing = held.bone.swing(angle) if held.bone else None
            report, load = self.at_pose(seen, held.dt_s, swing)
            if load is None:
                return report, None
            self._angle_rad = angle
            found = loads, _ = self._loads(held, pose, load)
            if search.is_met(-held.gains_N(*found), held.scale_N(*found)):
                self.stiffness_N_mm[own] = search.stiffness
                return report, load
            shown = held.shown(loads, self._plane.force_unit)
            logger.log(logging.INFO if search.is_slow else logging.DEBUG, "%s: %s", phase, shown)
            if search.has_failed:
                share = self._used_friction(load)
                why = "the skin slips" if share > _SLIPS else "the search does not converge"
                reason = f"the loads cannot be held: {shown}; {why}"
                return replace(report, converged=False, reason=reason), None
            self.discarded.append(report)
            last = self._extrapolate(last, x, search.x)

    def _loads(self, held: Held, pose: Pose, load: Load) -> tuple[Array, Array]:
        """Return the scaled loads, (4,), and the moments on the joint as `Bone` does, N."""
        in_space = self.in_space(load)
        loads = SCALES * pose.load(in_space.force_N, in_space.moment_Nmm)
        if held.bone is None:
            return loads, np.zeros(0)
        on_bone = load.bone_N, load.bone_Nmm
        return loads, held.bone.moments_N(self._angle_rad, held.dt_s, *on_bone)

    def _used_friction(self, load: Load) -> float:
        """Return the friction of all skin as a share of the largest."""
        own = [np.linalg.norm(load.friction_N, axis=1).sum(), load.bound_N.sum()]
        used, bound = self._problem.domain.comm.allreduce(np.array(own))
        return float(used / bound) if bound else 0.0

    def _extrapolate(self, last: Place, x_mm: np.ndarray, next_mm: np.ndarray) -> Place:
        """Move the displacement on as it changed on the way from the `last` place to this one."""
        u, way = self._problem.state.u.x.array, x_mm - last[0]
        here = x_mm, u.copy()
        if way.any():  # where it hardly moved, the displacement changed for another reason
            share = (next_mm - x_mm) @ way / (way @ way)
            u += np.clip(share, -1.0, 1.0) * (u - last[1])
        return here

    def _at_normal_force(self, held: Held, path: Pose, phase: str) -> Solved:
        """Solve for a normal force, which may jump with the depth."""
        z_mm = float(self._predicted(held, path)[0])
        wanted_N = float(held.loads[NORMAL])
        stiffness = float(self.stiffness_N_mm[NORMAL, NORMAL])
        search = ForceSearch(wanted_N, z_mm, stiffness, self._longest_mm)
        while True:
            z = search.z_mm
            report, load = self.at_pose(held.pose_at(np.array([z])), held.dt_s)
            if load is None:
                return report, None
            force = float(load.force_N[-1])
            if search.is_met(force):
                self.stiffness_N_mm[NORMAL, NORMAL] = search.stiffness_N_mm
                return report, load
            logger.log(
                logging.INFO if search.is_slow else logging.DEBUG,
                "%s: %.5g %s at %.5f mm, %.5g are sought",
                *(phase, force, self._plane.force_unit, z, wanted_N),
            )
            if search.has_failed:
                return replace(report, converged=False, reason=search.reason), None
            self.discarded.append(report)

    def _predicted(self, held: Held, path: Pose) -> np.ndarray:
        """Return the unknowns of a step if the body goes on as in the last one, (k,).

        A change of the loads' rates is made up for by the stiffness. By the `path` the body would
        have been there after the last step.
        """
        state, loads = self._problem.state, self.loads_N()
        x, wanted = self._unknowns(held, path), held.gains_N(loads)
        if state.dt_old_s:
            ratio = self._ratio(held.dt_s, holds=True)
            x = x + ratio * (x - self._unknowns(held, path, before=True))
            if self.loads_before_N is not None:
                wanted -= ratio * np.append(loads - self.loads_before_N, 0.0)[held.indices]
        stiffness = self.stiffness_N_mm[np.ix_(held.indices, held.indices)]
        return x + way_to(wanted, stiffness, self._longest_mm)

    def _unknowns(self, held: Held, path: Pose, *, before: bool = False) -> np.ndarray:
        """Return the unknowns after the last accepted step, or after that `before` it, (k,)."""
        angle = self.bone.before_rad if self.bone and before else self.angle_rad
        return held.unknowns(self.pose(before=before), path, angle)

    def note_stiffness(self, load: Load) -> None:
        """Note how the normal force grew with the depth, in a step towards the finger."""
        state = self._problem.state
        gained = load.force_N[-1] - state.force_old_N[-1]
        deeper = state.translation.value[-1] - state.translation_old.value[-1]
        if gained * deeper > 0:
            self.stiffness_N_mm[NORMAL, NORMAL] = gained / deeper

    def accept(self, load: Load, report: SolveReport) -> tuple[SolveReport, ...]:
        """Accept the step; return all of its solves, the last one being `report`."""
        self.loads_before_N = self.loads_N() if self._problem.state.dt_old_s else None
        if self.bone:  # before the state moves on
            self.bone = self.bone.moved(self._angle_rad, self._problem.state.dt_s)
        self._problem.accept(load)
        solves, self.discarded = (*self.discarded, report), []
        return solves
