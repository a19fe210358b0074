"""Complex linear equations in real numbers, as PETSc is usually built.

``(A + iB)(x + iy) = f + ig`` is

    [A  -B] [x]   [f]
    [B   A] [y] = [g],

solved by GMRES with one factorization, of ``A + B`` (Axelsson, Neytcheva and Ahmad 2014,
Numer. Algorithms 66). Options: ``tactile_harmonic_`` for GMRES, ``tactile_harmonic_sum_``
for the factorization.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from petsc4py import PETSc

import numpy as np

from tactile_fem.errors import TactileError

Array = np.ndarray
_RTOL, _MOST_IT, _RESTART = 1e-9, 300, 100


class _Preconditioner:
    """Solves with ``[A -B; B A]`` as with ``[A -B; B A + 2B]``: twice with ``A + B``."""

    def __init__(self, B: PETSc.Mat, inner: PETSc.KSP) -> None:
        self._B, self._inner = B, inner
        self._sum, self._product = B.createVecs()

    def apply(self, pc: PETSc.PC, right: PETSc.Vec, result: PETSc.Vec) -> None:
        del pc
        f, g = right.getNestSubVecs()
        x, y = result.getNestSubVecs()
        f.copy(self._sum)
        self._sum.axpy(1.0, g)
        self._inner.solve(self._sum, x)
        self._B.mult(x, self._product)
        self._product.aypx(-1.0, g)
        self._inner.solve(self._product, y)
        x.axpy(-1.0, y)


@contextmanager
def complex_solver(
    A: PETSc.Mat, B: PETSc.Mat
) -> Iterator[Callable[[Array, Array], tuple[Array, Array, int]]]:
    """Provide the solver of ``(A + iB)(x + iy) = f + ig``; A and B are destroyed in the end.

    It takes this rank's owned parts of f and g and returns those of x and y, and the iterations.

    Raises
    ------
    TactileError
        The linear solver does not converge.
    """
    comm = A.comm
    whole_sum = A.duplicate(copy=True)
    whole_sum.axpy(1.0, B, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    minus = B.duplicate(copy=True)
    minus.scale(-1.0)
    inner, outer = PETSc.KSP().create(comm), PETSc.KSP().create(comm)
    inner.setOperators(whole_sum)
    inner.setType("preonly")
    inner.getPC().setType("lu")
    inner.getPC().setFactorSolverType("mumps")
    inner.setOptionsPrefix("tactile_harmonic_sum_")
    inner.setFromOptions()
    block = PETSc.Mat().createNest([[A, minus], [B, A]], comm=comm)
    outer.setOperators(block)
    outer.setType("gmres")
    outer.setGMRESRestart(_RESTART)
    outer.setTolerances(rtol=_RTOL, atol=0.0, max_it=_MOST_IT)
    outer.getPC().setType("python")
    outer.getPC().setPythonContext(_Preconditioner(B, inner))
    outer.setOptionsPrefix("tactile_harmonic_")
    outer.setFromOptions()
    right, solution = (PETSc.Vec().createNest([*A.createVecs()], comm=comm) for _ in range(2))
    try:

        def solve(f: Array, g: Array) -> tuple[Array, Array, int]:
            for part, values in zip(right.getNestSubVecs(), (f, g), strict=True):
                part.array[:] = values
            outer.solve(right, solution)
            if outer.getConvergedReason() < 0:
                raise TactileError("the equations of a vibration could not be solved")
            x, y = (part.array.copy() for part in solution.getNestSubVecs())
            return x, y, outer.getIterationNumber()

        yield solve
    finally:
        for made in (outer, inner, block, whole_sum, minus, A, B, right, solution):
            made.destroy()
