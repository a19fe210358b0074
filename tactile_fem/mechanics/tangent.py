"""The Jacobian of Newton's method: the tissues' part is kept for a while, the contact's is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property

from petsc4py import PETSc

from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

# The viscous stress hardly changes where the duration of a step changes less than that.
_SAME_STEP = 0.01

# Quadrature degree of a tangent that is kept: exact for straight tetrahedra of constant stiffness.
KEPT_DEGREE = 2


class Tangent:
    """The Jacobian as the sum of the tissues' and the contact's part.

    The tissues' part hardly changes within a step, but takes nine tenths of the time to assemble.
    While it is kept it need not be exact either: four points in a tetrahedron do.

    Parameters
    ----------
    kept, contact
        The parts as forms; the contact's entries are among the tissues'.
    exact
        Makes the form of the tissues' part that is not kept, when it is first needed; never if
        none is kept, since `kept` is exact then.
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
        kept: fem.Form,
        exact: Callable[[], fem.Form],
        contact: fem.Form,
        bcs: Sequence[fem.DirichletBC],
        iterations: int,
    ) -> None:
        self._form, self._make_exact, self._contact, self._bcs = kept, exact, contact, bcs
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
            Whether the tissues' part has to be the derivative at the present displacement.
        """
        exact = exact or self._iterations == 1
        same_step = math.isclose(dt_s, self._dt_s, rel_tol=_SAME_STEP)
        outdated = self._uses >= self._iterations or not same_step
        if self._kept is None:  # its places are known to PETSc only once it is assembled
            self._assemble_tissues(matrix, exact)
            self._kept = matrix.duplicate(copy=True)
        elif exact or outdated:
            self._assemble_tissues(self._kept, exact)
        if exact or outdated:
            self._dt_s, self._uses = dt_s, 0
        self._uses += 1
        self._kept.copy(matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        fem_petsc.assemble_matrix(matrix, self._contact, self._bcs)
        matrix.assemble()

    @contextmanager
    def renewed(self) -> Iterator[None]:
        """Assemble the tissues' part exactly for every Jacobian within the context."""
        own, self._iterations = self._iterations, 1
        try:
            yield
        finally:
            self._iterations = own

    def expire(self) -> None:
        """Let the tissues' part be assembled for the next Jacobian."""
        self._uses = self._iterations

    def destroy(self) -> None:
        """Free the kept part; all ranks call."""
        if self._kept:
            self._kept.destroy()

    @cached_property
    def _exact(self) -> fem.Form:
        return self._make_exact() if self.is_kept else self._form

    def _assemble_tissues(self, matrix: PETSc.Mat, exact: bool) -> None:
        with common.Timer("tactile: tangent of the tissues"):
            matrix.zeroEntries()
            fem_petsc.assemble_matrix(matrix, self._exact if exact else self._form, self._bcs)
            matrix.assemble()
