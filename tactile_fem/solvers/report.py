"""What a solver offers, and how it reports."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.errors import TactileError
from tactile_fem.mechanics.domain import NodeOrder
from tactile_fem.mechanics.rows import Snapshot

_REASONS = {
    value: name.lower().replace("_", " ")
    for name, value in vars(PETSc.SNES.ConvergedReason).items()
    if isinstance(value, int)
}

LinearSolve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class SolveReport:
    """How one nonlinear solve ended.

    Attributes
    ----------
    iterations, linear_iterations
        Iterations of Newton's method, and of the linear solver in all of them.
    """

    converged: bool
    iterations: int
    linear_iterations: int
    residual_N: float
    reason: str

    @classmethod
    def of(cls, snes: PETSc.SNES) -> SolveReport:
        """Return how the last solve of `snes` ended."""
        reason: Any = snes.getConvergedReason()
        return cls(
            reason > 0,
            snes.getIterationNumber(),
            snes.getLinearSolveIterations(),
            float(snes.getFunctionNorm()),
            _REASONS.get(reason, str(reason)),
        )


def solve_linear(
    ksp: PETSc.KSP, right: PETSc.Vec, solution: PETSc.Vec, field: fem.Function
) -> np.ndarray:
    """Return the solution of linear equations as `field` holds it, ghosts included.

    Raises
    ------
    TactileError
        The solver does not converge.
    """
    ksp.solve(right, solution)
    reason: Any = ksp.getConvergedReason()
    if reason < 0:
        raise TactileError("the linear equations at a converged state could not be solved")
    solution.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
    fem_petsc.assign(solution, field)
    return field.x.array.copy()


class StepSolver(Protocol):
    """Finds the equilibrium of a problem's present step.

    By default, nothing is carried from step to step.

    Attributes
    ----------
    snes
        PETSc's nonlinear solver.
    options
        Its options without the prefix.
    """

    snes: PETSc.SNES
    options: dict[str, str | int | float | bool]

    def solve(self) -> SolveReport:
        """Run Newton's method from the problem's displacement, which becomes the result."""

    def end_step(self) -> None:
        """Prepare the next step at a converged state, before it is accepted."""

    def to_save(self, order: NodeOrder) -> Snapshot:
        """Return what it carries to the next step, as `State.to_save` does."""
        return {}

    def restore(self, saved: dict[str, np.ndarray], order: NodeOrder) -> None:
        """Go on from what was gathered, the problem being at the end of the last step."""

    def residual(self) -> np.ndarray:
        """Return this rank's residual at the present displacement, in N; zero where held."""

    def linearized(self) -> AbstractContextManager[LinearSolve]:
        """Provide the solver of linear equations with the Jacobian at the present displacement.

        It takes this rank's right-hand side and returns the solution as `State.u` holds it.
        """

    def close(self) -> None:
        """Free PETSc's objects; all ranks must call it."""
