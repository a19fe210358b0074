"""The equilibrium at the end of a step: the body is where the path or the held loads need it."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_fem.finger.plane import Plane
from tactile_fem.mechanics.load import Load
from tactile_fem.path.loads import NORMAL
from tactile_fem.simulation.balance import JOINT, SCALES, LoadBalance
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.load_search import LoadSearch, increment_for
from tactile_fem.simulation.pose import Pose
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.report import SolveReport

Array = np.ndarray
logger = logging.getLogger(__name__)

# Derivative of the loads with respect to the unknowns of `LoadBalance`, before any is known.
_FIRST_STIFFNESS_N_MM = np.diag([0.3, 0.3, 0.5, 0.1, 0.7])
_FIRST_STIFFNESS_N_MM[[NORMAL, JOINT], [JOINT, NORMAL]] = 0.5
# A step that holds loads extrapolates the last one by at most this ratio of their durations.
_MAX_RATIO_AT_LOADS = 2.0
# Share of the largest friction above which the skin is said to slip.
_SLIPS = 0.95


class Equilibrium:
    """Solves for the end of a step.

    Parameters
    ----------
    problem, plane
        The finger, and how its plane lies in space if it is a section.
    max_increment_mm
        Longest distance between two places of the body in the search for loads.
    bone
        Bone at the start; None if it is clamped.

    Attributes
    ----------
    solves
        Solves of the present step so far; the last one ended at the present state.
    stiffness_N_mm
        Derivative of the loads, as `LoadSearch` has it, as last observed, (5, 5).
    bone
        Bone after the last accepted step.
    """

    def __init__(
        self, problem: FingerProblem, plane: Plane, max_increment_mm: float, bone: Bone | None
    ) -> None:
        self._problem, self._plane, self._max_increment_mm = problem, plane, max_increment_mm
        self.solves: list[SolveReport] = []
        self.stiffness_N_mm = _FIRST_STIFFNESS_N_MM.copy()
        # Loads at the accepted step before the last one; None at the beginning of a piece.
        self._loads_before_N: Array | None = None
        self.bone = bone
        self._angle_rad = self.angle_rad  # of the bone, at the last solve

    # --- after the last accepted step ----------------------------------------------------------

    def pose(self, *, before: bool = False) -> Pose:
        """Return where the body was after the last accepted step, or after that `before` it."""
        state, plane, bone = self._problem.state, self._plane, self.bone
        place, rotation = state.translation_old.value, state.rotation_old
        if before:
            place, rotation = state.translation_before, state.rotation_before
        pose = Pose(plane.vectors(place), plane.rotation_in_space(rotation))
        return bone.in_space(pose, bone.before_rad if before else bone.angle_rad) if bone else pose

    def loads_N(self) -> Array:
        """Return the loads after the last accepted step, scaled as `LoadBalance` does, (4,)."""
        state = self._problem.state
        load = self._in_space(state.force_old_N, state.moment_old_Nmm, self.angle_rad)
        return SCALES * self.pose().load(*load)

    @property
    def angle_rad(self) -> float:
        """Angle of the bone after the last accepted step; 0 if it is clamped."""
        return self.bone.angle_rad if self.bone else 0.0

    # --- a step --------------------------------------------------------------------------------

    def solve(self, balance: LoadBalance, path: Pose, phase: str) -> Load | None:
        """Solve for the end of a step; return its load, or None if the last of `solves` failed.

        Parameters
        ----------
        balance
            Loads, and where the body is at the end by the path.
        path
            Pose by the path after the last step.
        phase
            Name of the piece of the path, for messages.
        """
        own = np.ix_(balance.indices, balance.indices)
        x = self._first_guess(balance, path)
        search = LoadSearch(x, self.stiffness_N_mm[own], self._max_increment_mm)
        last = self._last_place(balance)
        while True:
            x, load = search.x, self._solve_at(balance, search.x)
            if load is None:
                return None
            found = loads, _ = self._found(balance, x, load)
            if search.is_met(-balance.missing_N(*found), balance.scale_N(*found)):
                self.stiffness_N_mm[own] = search.stiffness
                return load
            shown = balance.shown(loads, self._plane.force_unit)
            logger.log(logging.INFO if search.is_slow else logging.DEBUG, "%s: %s", phase, shown)
            if search.has_failed:
                reason = self._not_met(balance, search, load, shown)
                self.solves[-1] = replace(self.solves[-1], converged=False, reason=reason)
                return None
            last = self._extrapolate(last, x, search.x)

    def _first_guess(self, balance: LoadBalance, path: Pose) -> Array:
        """Extrapolate the last step; return the unknowns, (k,), and change the displacement.

        This halves the Newton iterations. With the stiffness, the unknowns make up for a change of
        the loads' rates. By the `path` the body would have been there after the last step.
        """
        state, loads = self._problem.state, self.loads_N()
        state.reset()
        x = balance.unknowns(self.pose(), path, self.angle_rad)
        wanted = balance.missing_N(loads, np.zeros(0))
        if state.dt_old_s:
            u, old, before = state.u.x.array, state.u_old.x.array, state.u_before.x.array
            ratio = balance.dt_s / state.dt_old_s
            most = min(ratio, _MAX_RATIO_AT_LOADS)  # places found are as inexact as the loads
            u += (most if balance.components else ratio) * (old - before)
            angle = self.bone.before_rad if self.bone else 0.0
            x = x + most * (x - balance.unknowns(self.pose(before=True), path, angle))
            if self._loads_before_N is not None:
                gained = np.append(loads - self._loads_before_N, 0.0)
                wanted -= most * gained[balance.indices]
        stiffness = self.stiffness_N_mm[np.ix_(balance.indices, balance.indices)]
        return x + increment_for(wanted, stiffness, self._max_increment_mm)

    def _solve_at(self, balance: LoadBalance, x: Array) -> Load | None:
        """Solve for the unknowns (k,); return the load, or None if the last of `solves` failed."""
        pose, angle, bone, swing = balance.pose_at(x), balance.angle_rad(x), balance.bone, None
        if bone:
            pose, swing = bone.seen_from(pose, angle), bone.swing(angle)
        place, rotation = self._plane.within(pose.translation), self._plane.rotation(pose.rotation)
        report = self._problem.solve(place, balance.dt_s, rotation, swing)
        load = self._problem.load() if report.converged else None
        if load is not None and (reason := self._problem.rejection(load)):
            report, load = replace(report, converged=False, reason=reason), None
        self.solves.append(report)
        self._angle_rad = angle
        return load

    def _found(self, balance: LoadBalance, x: Array, load: Load) -> tuple[Array, Array]:
        """Return the scaled loads, (4,), and the moments on the joint as `Bone` does, N."""
        in_space = self.in_space(load)
        loads = SCALES * balance.pose_at(x).load(in_space.force_N, in_space.moment_Nmm)
        if balance.bone is None:
            return loads, np.zeros(0)
        on_bone = load.bone_N, load.bone_Nmm
        return loads, balance.bone.moments_N(self._angle_rad, balance.dt_s, *on_bone)

    def _not_met(self, balance: LoadBalance, search: LoadSearch, load: Load, shown: str) -> str:
        """Return in words why a search has failed."""
        normal_alone = balance.indices == [NORMAL]
        if search.jump_mm and normal_alone:
            low, high = search.jump_mm
            return (
                f"the force is not met: it jumps within {abs(high - low):.1g} mm at a depth of "
                f"{low:.4f} mm"
            )
        why = "the search does not converge"
        if self._used_friction(load) > _SLIPS:
            why = "the skin slips"
        return f"the {'force is' if normal_alone else 'loads are'} not met: {shown}; {why}"

    def _used_friction(self, load: Load) -> float:
        """Return the friction of all skin as a share of the largest."""
        own = [np.linalg.norm(load.friction_N, axis=1).sum(), load.bound_N.sum()]
        used, bound = self._problem.domain.comm.allreduce(np.array(own))
        return float(used / bound) if bound else 0.0

    def _last_place(self, balance: LoadBalance) -> tuple[Array, Array] | None:
        """Return unknowns and displacement after the last step if only the unknowns move the body.

        Otherwise the displacement changes for another reason as well.
        """
        pose = self.pose()
        x = balance.unknowns(pose, balance.pose, self.angle_rad)
        if balance.bone or not balance.pose_at(x).is_near(pose):
            return None
        return x, self._problem.state.u_old.x.array.copy()

    def _extrapolate(
        self, last: tuple[Array, Array] | None, x: Array, following: Array
    ) -> tuple[Array, Array]:
        """Move the displacement on as it changed from the `last` unknowns to `x`; return both."""
        u = self._problem.state.u.x.array
        here = x, u.copy()
        if last is not None and (increment := x - last[0]).any():
            share = (following - x) @ increment / (increment @ increment)
            u += np.clip(share, -1.0, 1.0) * (u - last[1])
        return here

    def in_space(self, load: Load) -> Load:
        """Return a load at the end of the last solve in space, with vectors (3,)."""
        force, moment = self._in_space(load.force_N, load.moment_Nmm, self._angle_rad)
        on_bone, about = self._in_space(load.bone_N, load.bone_Nmm, self._angle_rad)
        return replace(load, force_N=force, moment_Nmm=moment, bone_N=on_bone, bone_Nmm=about)

    def _in_space(self, force_N: Array, moment_Nmm: Array, angle_rad: float) -> tuple[Array, Array]:
        load = self._plane.vectors(force_N), self._plane.moment(moment_Nmm)
        return self.bone.load_in_space(*load, angle_rad) if self.bone else load

    def note_stiffness(self, load: Load) -> None:
        """Note how the normal force grew with the depth, in a step towards the finger."""
        state = self._problem.state
        gained = load.force_N[-1] - state.force_old_N[-1]
        deeper = state.translation.value[-1] - state.translation_old.value[-1]
        if gained * deeper > 0:
            self.stiffness_N_mm[NORMAL, NORMAL] = gained / deeper

    def accept(self, load: Load) -> list[SolveReport]:
        """Accept the step; return its solves, the last of which ended there."""
        self._loads_before_N = self.loads_N() if self._problem.state.dt_old_s else None
        if self.bone:  # before the state moves on
            self.bone = self.bone.moved(self._angle_rad, self._problem.state.dt_s)
        self._problem.accept(load)
        solves, self.solves = self.solves, []
        return solves

    # --- restart -------------------------------------------------------------------------------

    def to_save(self) -> dict[str, Any]:
        """Return what the next step needs beside the state, for JSON."""
        before = self._loads_before_N
        return {
            "stiffness_N_mm": self.stiffness_N_mm.tolist(),
            "loads_before_N": None if before is None else before.tolist(),
            "bone": self.bone.to_save() if self.bone else {},
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on from where `to_save` was called."""
        before = saved["loads_before_N"]
        self.stiffness_N_mm = np.array(saved["stiffness_N_mm"])
        self._loads_before_N = None if before is None else np.array(before)
        if self.bone:
            self.bone = replace(self.bone, **saved["bone"])
        self._angle_rad = self.angle_rad
