"""The plain solver: DOLFINx's NonlinearProblem with MUMPS, nothing kept from one call to the next.

It is what to read first, and the oracle for `tactile_fem.solvers.fast`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.assembly.compile import jit_options
from tactile_fem.assembly.tags import with_shared_tags
from tactile_fem.mechanics.problem import Problem
from tactile_fem.solvers.options import NEWTON, PLAIN, clear_options, set_options
from tactile_fem.solvers.report import LinearSolve, SolveReport, StepSolver, solve_linear


class PlainSolver(StepSolver):
    """Newton's method with the exact Jacobian, factorized in each iteration."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.options = {**NEWTON, **PLAIN, **problem.settings.petsc}
        self._prefix = set_options(self.options, problem.domain.comm)
        self._equations = equations = fem_petsc.NonlinearProblem(
            with_shared_tags(problem.terms.residual(problem.test)),
            problem.u,
            bcs=problem.bcs,
            petsc_options_prefix=self._prefix,
            jit_options=jit_options(problem.settings.compiler_flags),
            entity_maps=problem.contact.obstacle.entity_maps,
        )
        self.snes = equations.solver
        self.snes.setFromOptions()
        self.snes.setFunction(self._assemble, equations.b)

    def _assemble(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Expand the body's distance at the iterate, then let DOLFINx assemble the residual."""
        problem, own = self._problem, self._equations
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        fem_petsc.assign(x, problem.u)
        problem.contact.obstacle.refresh()
        fem_petsc.assemble_residual(snes, x, b, problem.u, own.F, own.J, problem.bcs)

    def solve(self) -> SolveReport:
        """Run Newton's method from the problem's displacement, which becomes the result."""
        self._equations.solve()
        return SolveReport.of(self.snes)

    def residual(self) -> np.ndarray:
        """Return this rank's residual at the present displacement, in N; zero where held."""
        own = self._equations
        fem_petsc.assign(self._problem.u, own.x)
        self._assemble(self.snes, own.x, own.b)
        return own.b.array.copy()

    @contextmanager
    def linearized(self) -> Iterator[LinearSolve]:
        """Provide the solver of linear equations with the Jacobian at the present displacement."""
        own, field = self._equations, fem.Function(self._problem.u.function_space)
        self.residual()
        self.snes.computeJacobian(own.x, own.A, own.A)
        ksp = self.snes.getKSP()
        ksp.setOperators(own.A)
        right, solution = own.b.duplicate(), own.x.duplicate()

        def solve(values: np.ndarray) -> np.ndarray:
            right.array[:] = values
            return solve_linear(ksp, right, solution, field)

        try:
            yield solve
        finally:
            right.destroy()
            solution.destroy()

    def close(self) -> None:
        """Free PETSc's objects; all ranks must call it."""
        own = self._equations
        for part in (own.solver, own.A, own.b, own.x):
            part.destroy()
        clear_options(self._prefix)
