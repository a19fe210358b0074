"""Newton's method as SNES runs it: when its Jacobian is good enough, and how it ended."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from petsc4py import PETSc

from tactile_fem.errors import TactileError

LinearSolve = Callable[[PETSc.Vec, PETSc.Vec], None]

# By how much a step with an old Jacobian may be worse than expected.
_CAUTION = 4.0
# Share of a step's largest residual below which skin no longer comes and goes.
_NEAR = 0.1
# Ratio of residuals above which a step near the solution was slow.
_SLOW = 0.5
# Of a linear solve, after which a new preconditioner, as costly as twenty, and a new tangent pay.
_FEW_ITERATIONS = 10
# Of linear equations at a converged state, such as those of sensitivities.
_LINEAR_RTOL, _LINEAR_MOST_IT = 1e-6, 400
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


def contact_is_found(snes: PETSc.SNES) -> bool:
    """Return whether Newton's method has come near the solution of a step.

    At first skin comes and goes and the residual hardly falls; then it falls fast.
    """
    norms, _ = snes.getConvergenceHistory()
    return bool(len(norms) and norms[-1] < _NEAR * max(norms))


def struggles(snes: PETSc.SNES) -> bool:
    """Return whether the last of Newton's steps shows that its Jacobian was out of date.

    Its linear solve was slow or, near the solution, it hardly reduced the residual.
    """
    if solves_slowly(snes):
        return True
    norms, _ = snes.getConvergenceHistory()
    return contact_is_found(snes) and norms[-1] > _SLOW * norms[-2]


def solves_slowly(snes: PETSc.SNES) -> bool:
    """Return whether the last linear solve of this step took more than a few iterations."""
    begun = snes.getIterationNumber() > 0
    return bool(begun and snes.getKSP().getIterationNumber() > _FEW_ITERATIONS)


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


@contextmanager
def linear_solver(snes: PETSc.SNES, A: PETSc.Mat) -> Iterator[LinearSolve]:
    """Provide the solver of linear equations with `A` and the preconditioner of `snes` as it is.

    It takes the right-hand side and the vector of the solution.

    Raises
    ------
    TactileError
        By the solver: it does not converge.
    """
    pc = snes.getKSP().getPC()
    pc.setReusePreconditioner(True)
    ksp = PETSc.KSP().create(snes.comm)
    ksp.setType("fgmres")
    ksp.setPC(pc)
    ksp.setOperators(A)
    ksp.setTolerances(rtol=_LINEAR_RTOL, atol=0.0, max_it=_LINEAR_MOST_IT)

    def solve(right: PETSc.Vec, solution: PETSc.Vec) -> None:
        ksp.solve(right, solution)
        if ksp.getConvergedReason() < 0:
            raise TactileError("the linear equations at a converged state could not be solved")

    try:
        yield solve
    finally:
        ksp.destroy()


def weakly(method: Callable[..., None]) -> Callable[..., None]:
    """Return a call of a bound method that does not keep its object alive."""
    reference = weakref.WeakMethod(method)
    return lambda *arguments: reference()(*arguments)
