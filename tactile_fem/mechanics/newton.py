"""Newton's method as SNES runs it: when its Jacobian is good enough, and how it ended."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass

from petsc4py import PETSc

# By how much a step with an old Jacobian may be worse than expected.
_CAUTION = 4.0
_REASONS = {
    value: name.lower().replace("_", " ")
    for name, value in vars(PETSc.SNES.ConvergedReason).items()
    if isinstance(value, int)
}


@dataclass(frozen=True)
class SolveReport:
    """How one nonlinear solve ended.

    Attributes
    ----------
    iterations, linear_iterations
        Of Newton's method, and of the linear solver in all of them.
    """

    converged: bool
    iterations: int
    linear_iterations: int
    residual_N: float
    reason: str

    @classmethod
    def of(cls, snes: PETSc.SNES) -> SolveReport:
        """Return how the last solve of `snes` ended."""
        reason = snes.getConvergedReason()
        return cls(
            reason > 0,
            snes.getIterationNumber(),
            snes.getLinearSolveIterations(),
            float(snes.getFunctionNorm()),
            _REASONS.get(reason, str(reason)),
        )


def next_step_converges(snes: PETSc.SNES) -> bool:
    """Return whether Newton's next step ends the solve even if the Jacobian stays as it is.

    Near the solution a step with the Jacobian of the last iterate reduces the residual by as much
    as the step before did; a new Jacobian would square this factor.
    """
    norms, _ = snes.getConvergenceHistory()
    iterating = snes.getConvergedReason() == PETSc.SNES.ConvergedReason.ITERATING
    if not iterating or len(norms) < 2:
        return False
    expected = norms[-1] ** 2 / norms[-2]
    return bool(_CAUTION * expected < snes.getTolerances()[1])


def weakly(method: Callable[..., None]) -> Callable[..., None]:
    """Return a call of a bound method that does not keep its object alive."""
    reference = weakref.WeakMethod(method)
    return lambda *arguments: reference()(*arguments)
