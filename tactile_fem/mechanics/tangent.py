"""The Jacobian of Newton's method: the tissues' part is kept for a while, the contact's is not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from petsc4py import PETSc

from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

# The viscous stress hardly changes where the duration of a step changes less than that.
_SAME_STEP = 0.01


class Tangent:
    """The Jacobian as the sum of the tissues' and the contact's part.

    The tissues' part hardly changes within a step, but takes nine tenths of the time to assemble.

    Parameters
    ----------
    tissues, contact
        The parts as forms; the contact's entries are among the tissues'.
    bcs
        Dirichlet conditions.
    iterations
        How often the tissues' part is used before it is assembled anew.

    Attributes
    ----------
    is_kept
        Whether it is used more than once.
    """

    def __init__(
        self,
        tissues: fem.Form,
        contact: fem.Form,
        bcs: Sequence[fem.DirichletBC],
        iterations: int,
    ) -> None:
        self._tissues, self._contact, self._bcs = tissues, contact, bcs
        self._iterations, self._uses = iterations, 0
        self.is_kept = iterations > 1
        self._kept: PETSc.Mat | None = None
        self._dt_s = 0.0

    def assemble(self, matrix: PETSc.Mat, dt_s: float, *, exact: bool = False) -> None:
        """Assemble the Jacobian at the present displacement into `matrix`.

        Parameters
        ----------
        matrix
            Always the same, the solver's.
        dt_s
            Duration of the step, on which the viscous stress depends.
        exact
            Whether the tissues' part has to be that of the present displacement.
        """
        same_step = math.isclose(dt_s, self._dt_s, rel_tol=_SAME_STEP)
        outdated = self._uses >= self._iterations or not same_step
        if self._kept is None:  # its places are known to PETSc only once it is assembled
            self._assemble_tissues(matrix)
            self._kept = matrix.duplicate(copy=True)
        elif exact or outdated:
            self._assemble_tissues(self._kept)
        if exact or outdated:
            self._dt_s, self._uses = dt_s, 0
        self._uses += 1
        self._kept.copy(matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        fem_petsc.assemble_matrix(matrix, self._contact, self._bcs)
        matrix.assemble()

    @contextmanager
    def renewed(self) -> Iterator[None]:
        """Assemble the tissues' part for every Jacobian within the context."""
        own, self._iterations = self._iterations, 1
        try:
            yield
        finally:
            self._iterations = own

    def expire(self) -> None:
        """Let the next Jacobian be exact."""
        self._uses = self._iterations

    def destroy(self) -> None:
        """Free the kept part; all ranks call."""
        if self._kept:
            self._kept.destroy()

    def _assemble_tissues(self, matrix: PETSc.Mat) -> None:
        with common.Timer("tactile: tangent of the tissues"):
            matrix.zeroEntries()
            fem_petsc.assemble_matrix(matrix, self._tissues, self._bcs)
            matrix.assemble()
