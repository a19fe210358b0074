"""The equilibrium with the body at a place, or at loads that it is moved to meet."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from tactile_fem.finger.plane import Plane
from tactile_fem.mechanics.load import Load
from tactile_fem.path.loads import NORMAL
from tactile_fem.simulation.control import ForceSearch
from tactile_fem.simulation.held import SCALES, Held, Pose
from tactile_fem.simulation.load_search import LoadSearch
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.report import SolveReport

logger = logging.getLogger(__name__)

# Loads over the body's motion along X, Y and Z, and its turn, before any is known.
_FIRST_STIFFNESS_N_MM = (0.3, 0.3, 0.5, 0.1)
# Contact force and the forces of the tissues differ by what the residual's norm allows.
_BALANCE_N = 1e-5

# How a solve ended and, if it succeeded, the load at its end.
Solved = tuple[SolveReport, Load | None]
# Unknowns of a search, and the displacement there.
Place = tuple[np.ndarray, np.ndarray]


class Equilibrium:
    """Solves for the end of a step; messages state forces in `force_unit`.

    In the search for loads two places of the body are at most `longest_mm` apart.
    """

    def __init__(self, problem: FingerProblem, plane: Plane, longest_mm: float) -> None:
        self._problem, self._plane, self._longest_mm = problem, plane, longest_mm
        # Solves of the present step that failed or did not meet the wanted loads.
        self.discarded: list[SolveReport] = []
        # Loads over the body's motion, as last observed.
        self.stiffness_N_mm = np.diag(_FIRST_STIFFNESS_N_MM)
        # Loads at the accepted step before the last one; None at the begin of a piece.
        self.loads_before_N: np.ndarray | None = None
        self._is_guided = False

    def pose(self, *, before: bool = False) -> Pose:
        """Return where the body was after the last accepted step, or after that `before` it."""
        state, plane = self._problem.state, self._plane
        place, rotation = state.translation_old.value, state.rotation_old
        if before:
            place, rotation = state.translation_before, state.rotation_before
        return Pose(plane.vectors(place), plane.rotation_in_space(rotation))

    def loads_N(self) -> np.ndarray:
        """Return the loads after the last accepted step, scaled as `Held` does, (4,)."""
        force, moment = self._problem.state.force_old_N, self._problem.state.moment_old_Nmm
        own = self._plane.vectors(force), self._plane.moment(moment)
        return SCALES * self.pose().load(*own)

    def predict(self, dt_s: float, way_mm: np.ndarray | None = None) -> None:
        """Make the initial guess from the change of the displacement in a similar scan.

        Without one the last step is extrapolated, which halves the Newton iterations.
        """
        state = self._problem.state
        state.reset()
        self._is_guided = way_mm is not None
        if way_mm is not None:
            state.u.x.array[:] += way_mm
        elif state.dt_old_s:
            u, old, before = state.u.x.array, state.u_old.x.array, state.u_before.x.array
            u += (dt_s / state.dt_old_s) * (old - before)

    def at_pose(self, pose: Pose, dt_s: float) -> Solved:
        """Solve with the body at `pose`."""
        place, rotation = self._plane.within(pose.translation), self._plane.rotation(pose.rotation)
        report = self._problem.solve(place, dt_s, rotation)
        if not report.converged and self._is_guided:
            self.discarded.append(report)
            self.predict(dt_s)
            report = self._problem.solve(place, dt_s, rotation)
        load = self._problem.load() if report.converged else None
        if load is not None and not load.is_finite:
            return replace(report, converged=False, reason="the load is not finite"), None
        return report, load

    def at_loads(self, held: Held, dt_s: float, phase: str, x_mm: np.ndarray) -> Solved:
        """Solve for the loads that are held; the search begins with the unknowns `x_mm`, (k,).

        The piece of the path is called `phase` in messages.
        """
        if held.components == (NORMAL,):
            return self._at_normal_force(held, dt_s, phase, float(x_mm[0]))
        own = np.ix_(held.components, held.components)
        search = LoadSearch(x_mm, self.stiffness_N_mm[own], self._longest_mm)
        last = held.unknowns(self.pose(), held.pose), self._problem.state.u_old.x.array.copy()
        while True:
            x, pose = search.x, held.pose_at(search.x)
            report, load = self.at_pose(pose, dt_s)
            if load is None:
                return report, None
            loads = held.loads_of(pose, load)
            if search.is_met(held.excess_N(loads), held.scale_N(loads)):
                self.stiffness_N_mm[own] = search.stiffness
                return report, load
            message = f"{phase}: {held.shown(loads)}"
            logger.log(logging.INFO if search.is_slow else logging.DEBUG, "%s", message)
            if search.has_failed:
                why = "the skin slips" if search.slips else "the search does not converge"
                reason = f"the loads cannot be held: {held.shown(loads)}; {why}"
                return replace(report, converged=False, reason=reason), None
            self.discarded.append(report)
            last = self._extrapolate(last, x, search.x)

    def _extrapolate(self, last: Place, x_mm: np.ndarray, next_mm: np.ndarray) -> Place:
        """Move the displacement on as it changed on the way from the `last` place to this one."""
        u, way = self._problem.state.u.x.array, x_mm - last[0]
        here = x_mm, u.copy()
        if way.any():
            u += (next_mm - x_mm) @ way / (way @ way) * (u - last[1])
        return here

    def _at_normal_force(self, held: Held, dt_s: float, phase: str, z_mm: float) -> Solved:
        """Solve for a normal force, which may jump with the depth."""
        wanted_N = float(held.loads[NORMAL])
        stiffness = float(self.stiffness_N_mm[NORMAL, NORMAL])
        search = ForceSearch(wanted_N, z_mm, stiffness, self._longest_mm)
        while True:
            z = search.z_mm
            report, load = self.at_pose(held.pose_at(np.array([z])), dt_s)
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

    def predicted(self, held: Held, path: Pose, dt_s: float) -> np.ndarray:
        """Return the unknowns of a step if the body goes on as in the last one, (k,).

        A change of the loads' rates is made up for by the stiffness. By the `path` the body would
        have been there after the last step.
        """
        state, loads = self._problem.state, self.loads_N()
        x = held.unknowns(self.pose(), path)
        wanted = -held.excess_N(loads)
        if state.dt_old_s:
            ratio, own = dt_s / state.dt_old_s, list(held.components)
            x = x + ratio * (x - held.unknowns(self.pose(before=True), path))
            if self.loads_before_N is not None:
                wanted -= ratio * (loads - self.loads_before_N)[own]
        stiffness = self.stiffness_N_mm[np.ix_(held.components, held.components)]
        return x + LoadSearch(x, stiffness, self._longest_mm).way_to(wanted)

    def note_stiffness(self, load: Load) -> None:
        """Note how the normal force grew with the depth, in a step towards the finger."""
        state = self._problem.state
        gained = load.force_N[-1] - state.force_old_N[-1]
        deeper = state.translation.value[-1] - state.translation_old.value[-1]
        if gained * deeper > 0:
            self.stiffness_N_mm[NORMAL, NORMAL] = gained / deeper

    def accept(self, load: Load, report: SolveReport) -> tuple[SolveReport, ...]:
        """Accept the step; return all of its solves, the last one being `report`."""
        if not load.imbalance_N <= _BALANCE_N:
            logger.warning(
                "contact force and held reaction differ by %.1e %s: the step is not in equilibrium",
                *(load.imbalance_N, self._plane.force_unit),
            )
        self.loads_before_N = self.loads_N() if self._problem.state.dt_old_s else None
        self._problem.accept(load)
        solves, self.discarded = (*self.discarded, report), []
        return solves
