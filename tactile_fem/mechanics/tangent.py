"""How long Newton's method keeps the tissues' part of the Jacobian; the contact's it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from tactile_fem.mechanics.jacobian import Jacobian

# The viscous stress hardly changes where the duration of a step changes less than that.
_SAME_STEP = 0.01


class Tangent:
    """Decides when the tissues' part of the Jacobian is assembled anew.

    It hardly changes within a step, but takes nine tenths of the time to assemble.
    A step begins with that of an earlier state. It is assembled anew where the contact is found,
    where it turns out to be of no use any more, and after so many iterations without.

    Parameters
    ----------
    jacobian
        The Jacobian.
    iterations
        How often a step uses the tissues' part before it is assembled anew.

    Attributes
    ----------
    is_kept
        Whether it is used more than once.
    """

    def __init__(self, jacobian: Jacobian, iterations: int) -> None:
        self._jacobian, self._iterations = jacobian, iterations
        self.is_kept = iterations > 1
        self._dt_s = 0.0
        self._uses, self._is_of_this_solve = iterations, False

    def assemble(
        self, dt_s: float, *, contact_is_found: bool = False, is_outdated: bool = False
    ) -> None:
        """Assemble the Jacobian at the present displacement.

        Parameters
        ----------
        dt_s
            Duration of the step, on which the viscous stress depends.
        contact_is_found
            Whether the present displacement is near the solution.
        is_outdated
            Whether the last iteration shows that the kept part is of no use any more.
        """
        same_step = math.isclose(dt_s, self._dt_s, rel_tol=_SAME_STEP)
        found_anew = contact_is_found and not self._is_of_this_solve
        worn_out = self._iterations == 1 or self._uses >= self._iterations
        if is_outdated or worn_out or found_anew or not same_step:
            self._jacobian.assemble_tissues()
            self._dt_s, self._uses, self._is_of_this_solve = dt_s, 0, True
        self._uses += 1
        self._jacobian.assemble_contact()

    def begin_solve(self) -> None:
        """Take the tissues' part as that of an earlier state."""
        self._uses, self._is_of_this_solve = 0, False

    @contextmanager
    def renewed(self) -> Iterator[None]:
        """Assemble the tissues' part for every Jacobian within the context."""
        own, self._iterations = self._iterations, 1
        try:
            yield
        finally:
            self._iterations = own

    def expire(self) -> None:
        """Let the next Jacobian be that of the present displacement."""
        self._uses = self._iterations
