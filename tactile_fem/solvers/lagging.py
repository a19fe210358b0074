"""When the tangent is new, and when the preconditioner.

The tissues' part of the Jacobian hardly changes within a step, but takes nine tenths of the time to
assemble, so it is lagged: Newton iterations share it. The contact's part never is. A step begins
with the last step's tangent, and a preconditioner made at the accepted state.

=====================  ===========================================================================
new tangent            where the contact zone has been found; where the last iteration shows that
                       the lagged one is out of date; after so many uses; if the time step changes
new preconditioner     where the last linear solve was slow
neither                if the next iteration will converge with the Jacobian of the last
=====================  ===========================================================================
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

# The viscous stress hardly changes where the time step changes by less than this share.
_STEP_TOLERANCE = 0.01
# By how much an iteration with the last Jacobian may be worse than expected.
_SAFETY_FACTOR = 4.0
# At first the active contact set changes; below this share of the largest residual it is found.
_CONTACT_SEARCH_SHARE = 0.1
# Ratio of two residuals above which an iteration near the solution was slow.
_SLOW_RATIO = 0.5
# Beyond this many linear iterations a new preconditioner (cost: about twenty) pays off.
_SLOW_LINEAR_SOLVE = 10


class Lagging:
    """Decides for the solver of one problem.

    Parameters
    ----------
    max_uses
        Uses of a tangent before it is assembled anew; 1 is Newton's method as it stands.

    Attributes
    ----------
    is_of_this_solve
        Whether the present solve has assembled the tangent.
    """

    def __init__(self, max_uses: int) -> None:
        self._max_uses = self._uses = max_uses
        self.is_of_this_solve = False
        self._dt_s = 0.0

    @property
    def is_on(self) -> bool:
        """Whether iterations share a tangent."""
        return self._max_uses > 1

    @contextmanager
    def off(self) -> Iterator[None]:
        """Have a new tangent in each iteration within the context."""
        usual, self._max_uses = self._max_uses, 1
        try:
            yield
        finally:
            self._max_uses = usual

    def begin_solve(self) -> None:
        """Count the tangent at hand as that of an earlier state."""
        self._uses, self.is_of_this_solve = 0, False

    def discard(self) -> None:
        """Have the next tangent assembled."""
        self._uses = self._max_uses

    def needs_tangent(self, snes: PETSc.SNES, dt_s: float) -> bool:
        """Return whether to assemble the tangent now, as will be done then."""
        found = _contact_is_found(snes)
        renew = (
            self._uses >= self._max_uses
            or not self.is_on
            or not math.isclose(dt_s, self._dt_s, rel_tol=_STEP_TOLERANCE)
            or self.needs_preconditioner(snes)
            or (found and not self.is_of_this_solve)
            or (found and _was_slow(snes))
        )
        if renew:
            self._dt_s, self._uses, self.is_of_this_solve = dt_s, 0, True
        self._uses += 1
        return renew

    @staticmethod
    def needs_preconditioner(snes: PETSc.SNES) -> bool:
        """Return whether the last linear solve of this step was slow."""
        begun = snes.getIterationNumber() > 0
        return bool(begun and snes.getKSP().getIterationNumber() > _SLOW_LINEAR_SOLVE)

    @staticmethod
    def needs_nothing(snes: PETSc.SNES) -> bool:
        """Return whether the next iteration converges even with the Jacobian of the last one.

        Near the solution it reduces the residual by as much as the iteration before did; a new
        Jacobian would square this factor.
        """
        norms, _ = snes.getConvergenceHistory()
        reason: Any = snes.getConvergedReason()
        if reason != PETSc.SNES.ConvergedReason.ITERATING or len(norms) < 2:
            return False
        expected = norms[-1] ** 2 / norms[-2]
        return bool(_SAFETY_FACTOR * expected < snes.getTolerances()[1])


def _contact_is_found(snes: PETSc.SNES) -> bool:
    """Return whether Newton's method has come near the solution of a step.

    At first the active contact set changes and the residual hardly falls; then it falls fast.
    """
    norms, _ = snes.getConvergenceHistory()
    return bool(len(norms) and norms[-1] < _CONTACT_SEARCH_SHARE * max(norms))


def _was_slow(snes: PETSc.SNES) -> bool:
    """Return whether the last iteration hardly reduced the residual."""
    norms, _ = snes.getConvergenceHistory()
    return bool(norms[-1] > _SLOW_RATIO * norms[-2])
