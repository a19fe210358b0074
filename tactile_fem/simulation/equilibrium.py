"""The equilibrium with the body at a position, or at a normal force."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from tactile_fem.mechanics.load import Load
from tactile_fem.simulation.control import ForceSearch
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.report import SolveReport

logger = logging.getLogger(__name__)

# Normal force over depth before any contact.
_FIRST_STIFFNESS_N_MM = 0.5
# Contact force and the forces of the tissues differ by what the residual's norm allows.
_BALANCE_N = 1e-5

# How a solve ended and, if it succeeded, the load at its end.
Solved = tuple[SolveReport, Load | None]


class Equilibrium:
    """Solves for the end of a step; messages state forces in `force_unit`.

    In the search for a force two heights of the body are at most `longest_mm` apart.
    """

    def __init__(self, problem: FingerProblem, force_unit: str, longest_mm: float) -> None:
        self._problem, self._unit, self._longest_mm = problem, force_unit, longest_mm
        # Solves of the present step that failed or did not meet the wanted force.
        self.discarded: list[SolveReport] = []
        self.stiffness_N_mm = 0.0  # normal force over depth, as last observed; 0 if not known
        self._is_guided = False

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

    def predicted_z_mm(self, dt_s: float) -> float:
        """Return the height of the body if it goes on as in the last step."""
        state = self._problem.state
        z = state.translation_old.value[-1]
        if state.dt_old_s:
            z += (dt_s / state.dt_old_s) * (z - state.translation_before[-1])
        return float(z)

    def at_position(self, position: np.ndarray, dt_s: float) -> Solved:
        """Solve with the body at `position`."""
        report = self._problem.solve(position, dt_s)
        if not report.converged and self._is_guided:
            self.discarded.append(report)
            self.predict(dt_s)
            report = self._problem.solve(position, dt_s)
        load = self._problem.load() if report.converged else None
        if load is not None and not load.is_finite:
            return replace(report, converged=False, reason="the load is not finite"), None
        return report, load

    def at_force(self, position: np.ndarray, dt_s: float, force_N: float, phase: str) -> Solved:
        """Solve for a normal force; the height in `position` is where its search begins.

        The piece of the path is called `phase` in messages.
        """
        stiffness = self.stiffness_N_mm or _FIRST_STIFFNESS_N_MM
        search = ForceSearch(force_N, float(position[-1]), stiffness, self._longest_mm)
        while True:
            z = search.z_mm
            report, load = self.at_position(np.array([*position[:-1], z]), dt_s)
            if load is None:
                return report, None
            force = float(load.force_N[-1])
            if search.is_met(force):
                self.stiffness_N_mm = search.stiffness_N_mm
                return report, load
            logger.log(
                logging.INFO if search.is_slow else logging.DEBUG,
                "%s: %.5g %s at %.5f mm, %.5g are sought",
                *(phase, force, self._unit, z, force_N),
            )
            if search.has_failed:
                return replace(report, converged=False, reason=search.reason), None
            self.discarded.append(report)

    def note_stiffness(self, load: Load) -> None:
        """Note how the normal force grew with the depth, in a step towards the finger."""
        state = self._problem.state
        gained = load.force_N[-1] - state.force_old_N[-1]
        deeper = state.translation.value[-1] - state.translation_old.value[-1]
        if gained * deeper > 0:
            self.stiffness_N_mm = float(gained / deeper)

    def accept(self, load: Load, report: SolveReport) -> tuple[SolveReport, ...]:
        """Accept the step; return all of its solves, the last one being `report`."""
        if not load.imbalance_N <= _BALANCE_N:
            logger.warning(
                "contact force and held reaction differ by %.1e %s: the step is not in equilibrium",
                *(load.imbalance_N, self._unit),
            )
        self._problem.accept(load)
        solves, self.discarded = (*self.discarded, report), []
        return solves
