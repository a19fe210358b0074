"""A problem with its solver: place the body, solve, accept."""

from __future__ import annotations

import atexit
import math
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from tactile_fem.errors import ConvergenceError
from tactile_fem.mechanics.load import Load
from tactile_fem.mechanics.problem import Problem
from tactile_fem.mechanics.rows import Snapshot, gathered
from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.report import SolveReport, StepSolver

# Least imbalance of forces that is an error, whatever the solver's tolerance.
_BALANCE_N = 1e-5
# Problems on several ranks, until they are closed, in the order in which they were made.
_OPEN: dict[FingerProblem, None] = {}


class FingerProblem(Problem):
    """A finger that is stepped by hand.

    On one rank an unused problem is freed by Python. Several ranks must destroy its solver
    together, but each collects its garbage at its own time: there a problem stays until it is
    closed.

    ::

        problem = FingerProblem(domain, tissue, body, friction=0.3, solver=Solver())
        for place in path:
            assert problem.solve(place, dt_s=0.01).converged
            load = problem.accept()

    Parameters
    ----------
    *args, **kwargs
        See `Problem`.
    make_solver
        Makes the solver, such as `tactile_fem.solvers.plain.PlainSolver`.

    Attributes
    ----------
    solver
        Solves the steps.
    """

    def __init__(
        self,
        *args: Any,
        make_solver: Callable[[Problem], StepSolver] = FastSolver,
        **kwargs: Any,
    ) -> None:
        super().__init__(*args, **kwargs)
        # A proxy: in a circle, PETSc's objects would wait for the garbage collector.
        self.solver = make_solver(weakref.proxy(self))
        self._iterations = 0
        if self.domain.comm.size > 1:
            _OPEN[self] = None

    def solve(
        self,
        translation: np.ndarray,
        dt_s: float,
        rotation: np.ndarray | None = None,
        swing: np.ndarray | None = None,
    ) -> SolveReport:
        """Find the equilibrium with the body at `translation` (3,), `dt_s` after the last one.

        The body turns to `rotation` (3, 3) about its origin; by default it does not turn. The bone
        swings by `swing`, see `State`; by default it does not.
        `u` is the initial guess and the result; on failure the caller resets the state.
        """
        self.begin_step(translation, dt_s, rotation, swing)
        report = self.solver.solve()
        self._iterations = report.iterations
        return report

    def accept(self, load: Load | None = None) -> Load:
        """Make the present state the history of the next step; return its load.

        Parameters
        ----------
        load
            Load at the present state, if `load` has been called there; read here otherwise.

        Raises
        ------
        ConvergenceError
            The load is not finite, or the state is not in equilibrium.
        """
        load = load or self.load()
        if reason := self.rejection(load):
            raise ConvergenceError(f"a state cannot be accepted: {reason}", load.force_N, reason)
        if self._iterations or self.state.iterations:
            self.solver.end_step()
        self.state.accept(load.force_N, load.moment_Nmm, load.friction_N, self._iterations)
        self._iterations = 0
        return load

    def rejection(self, load: Load) -> str:
        """Return why the present state must not be accepted, with its load; empty if it may."""
        # The sum of the residual is at most its norm times the square root of its length.
        allowed_N = self.solver.snes.getTolerances()[1] * math.sqrt(self.unknowns)
        return load.rejection(max(allowed_N, _BALANCE_N))

    def to_save(self) -> Snapshot:
        """Return the accepted state, as `State.to_save` does, and what the solver carries."""
        return {**self.state.to_save(self.order), **self.solver.to_save(self.order)}

    def gather(self) -> dict[str, np.ndarray]:
        """Return the same, gathered on the first rank; all ranks call."""
        return gathered(self.to_save())

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Restore what `gather` returned; the next step takes the same iterations.

        All ranks call, with what they got.
        """
        self.state.restore(saved, self.order)
        if self.state.iterations:
            with self.reopened():
                self.solver.restore(saved, self.order)

    def close(self) -> None:
        """Free the solver; all ranks must call it. `state` stays."""
        self.solver.close()
        _OPEN.pop(self, None)


@atexit.register
def _close_all() -> None:
    """Close open problems at exit, in the same order on all ranks: destruction is collective."""
    for problem in list(_OPEN):
        problem.close()
