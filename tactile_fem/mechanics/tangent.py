"""The Jacobian of Newton's method: the tissues' part is kept for a while, the contact's is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from petsc4py import PETSc

from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

# The viscous stress hardly changes where the duration of a step changes less than that.
_SAME_STEP = 0.01


class Tangent:
    """The Jacobian as the sum of the tissues' and the contact's part.

    The tissues' part hardly changes within a step, but takes nine tenths of the time to assemble.
    A step begins with that of an earlier state. It is assembled anew where the contact is found,
    where it turns out to be of no use any more, and after so many iterations without.

    Parameters
    ----------
    tissues, contact
        The parts as forms, the contact's as it is now; its entries are among the tissues'.
    bcs
        Dirichlet conditions.
    iterations
        How often a step uses the tissues' part before it is assembled anew.

    Attributes
    ----------
    is_kept
        Whether it is used more than once.
    """

    def __init__(
        self,
        tissues: fem.Form,
        contact: Callable[[], fem.Form],
        bcs: Sequence[fem.DirichletBC],
        iterations: int,
    ) -> None:
        self._tissues, self._contact, self._bcs = tissues, contact, bcs
        self._iterations = iterations
        self.is_kept = iterations > 1
        self._kept: PETSc.Mat | None = None
        self._dt_s = 0.0
        self._uses, self._is_of_this_solve = 0, False

    def assemble(
        self,
        matrix: PETSc.Mat,
        dt_s: float,
        *,
        contact_is_found: bool = False,
        is_outdated: bool = False,
    ) -> None:
        """Assemble the Jacobian at the present displacement into `matrix`.

        Parameters
        ----------
        matrix
            Always the same, the solver's.
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
            self._renew(matrix)
            self._dt_s, self._uses, self._is_of_this_solve = dt_s, 0, True
        self._uses += 1
        self._kept.copy(matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._add_contact(matrix)

    def begin_solve(self) -> None:
        """Take the tissues' part as that of an earlier state."""
        self._uses, self._is_of_this_solve = 0, False

    def assemble_exactly(self, matrix: PETSc.Mat, tissues: fem.Form) -> None:
        """Assemble the Jacobian with `tissues` in place of its own form of their part."""
        self._assemble(matrix, tissues)
        self._add_contact(matrix)

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

    def destroy(self) -> None:
        """Free the kept part; all ranks call."""
        if self._kept:
            self._kept.destroy()

    def _renew(self, matrix: PETSc.Mat) -> None:
        """Assemble the tissues' part; `matrix` is the first to know where its entries are."""
        if self._kept is None:
            self._assemble(matrix, self._tissues)
            self._kept = matrix.duplicate(copy=True)
        else:
            self._assemble(self._kept, self._tissues)

    def _assemble(self, matrix: PETSc.Mat, tissues: fem.Form) -> None:
        with common.Timer("tactile: tangent of the tissues"):
            matrix.zeroEntries()
            fem_petsc.assemble_matrix(matrix, tissues, self._bcs)
            matrix.assemble()

    def _add_contact(self, matrix: PETSc.Mat) -> None:
        fem_petsc.assemble_matrix(matrix, self._contact(), self._bcs)
        matrix.assemble()
