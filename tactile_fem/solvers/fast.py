"""The fast solver: Newton's method with a lagged tangent, on the skin near the body, by multigrid.

`tactile_fem.solvers.lagging` decides when tangent and preconditioner are new. From one step to the
next the solver carries the displacement at which the tangent was assembled; the preconditioner
follows from it and the accepted state. So a scan may be restarted from any step.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.assembly.compile import jit_options
from tactile_fem.mechanics.domain import NodeOrder
from tactile_fem.mechanics.problem import Problem
from tactile_fem.mechanics.rows import Snapshot
from tactile_fem.solvers import multigrid
from tactile_fem.solvers.jacobian import Jacobian
from tactile_fem.solvers.lagging import Lagging
from tactile_fem.solvers.near_skin import NearSkin
from tactile_fem.solvers.options import clear_options, options_of, set_options
from tactile_fem.solvers.report import LinearSolve, SolveReport, StepSolver, solve_linear

# Where Newton's method fails: width of the onset of contact, as a multiple, and softness of
# friction with which it is tried first.
_REGULARIZATIONS = ((1.0, 0.3), (4.0, 0.3))
# Share of the residual that ends Newton's method, at which any linear solve may end (Kelley 1995).
_LINEAR_ATOL_SHARE = 0.3
# For linear equations at a converged state, such as those of sensitivities.
_LINEAR_RTOL, _LINEAR_MAX_IT = 1e-6, 400


class FastSolver(StepSolver):
    """Solves the steps of a problem.

    Parameters
    ----------
    problem
        Its `settings` state PETSc's options, the compiler's flags, and how long a tangent is
        lagged.

    Attributes
    ----------
    snes
        PETSc's nonlinear solver.
    options
        PETSc's options without the prefix.
    """

    def __init__(self, problem: Problem) -> None:
        settings, u, v = problem.settings, problem.u, problem.test
        self._problem, self._state = problem, problem.state
        self._jit = jit_options(settings.compiler_flags)
        self.options = options_of(settings)
        self._lagging = Lagging(settings.tangent_iterations)
        # Around an inner solver (NGMRES, Anderson) the outer iteration solves nothing linear.
        has_inner = "npc_snes_type" in self.options
        uses_multigrid = self.options["pc_type"] == "mg" and not has_inner
        if uses_multigrid:
            msh = u.function_space.mesh
            vertices, dim = msh.topology.index_map(0).size_global, msh.geometry.dim
            self.options = {**multigrid.coarse_options(vertices, dim), **self.options}
        self.snes = self._newton()
        self._x, self._b = (fem_petsc.create_vector(u.function_space) for _ in range(2))
        self._near = NearSkin(problem.contact)
        is_symmetric = problem.bulk.is_symmetric
        self._contact = problem.virtual_work(problem.contact.residual(v))
        self._bulk_of_tangent = self._bulk = problem.bulk_work
        if self._lagging.is_on:
            work = problem.bulk.work_of_tangent(v)
            self._bulk_of_tangent = problem.virtual_work(work, is_symmetric=is_symmetric)
        skin = np.unique(np.concatenate([pairs[::2] for pairs in self._near.all.values()]))
        kind = "baij" if uses_multigrid else None
        self._jacobian = Jacobian(problem, self._contact, skin, kind, self._jit)
        self._tangent_at = problem.u.x.array.copy()
        self._two_level: multigrid.TwoLevel | None = None
        self._operator = self._single = self._jacobian.matrix
        if uses_multigrid:
            self._operator, self._single = self._jacobian.operators()
            self._two_level = multigrid.TwoLevel(
                self.snes,
                u.function_space,
                problem.held,
                problem.order.blocks(),
                self._jacobian.parts,
                self._jit,
            )
            if self._two_level.aggregates:
                self._jacobian.assemble_bulk(self._bulk_of_tangent)
                self._two_level.aggregate()
        # By weak references: Python's garbage collector cannot see what PETSc holds. A solver that
        # PETSc held would never be freed, and MPI allows only some 2,000 communicators.
        residual, jacobian = _weakly(self._assemble_residual), _weakly(self._assemble_jacobian)
        for snes in [self.snes, *([self.snes.getNPC()] if has_inner else [])]:
            snes.setFunction(residual, self._b)
            snes.setJacobian(jacobian, self._operator, self._jacobian.matrix)

    def _newton(self) -> PETSc.SNES:
        """Return PETSc's nonlinear solver; this object assembles what it solves."""
        comm = self._problem.domain.comm
        prefix = set_options(self.options, comm)
        self._clear_options = weakref.finalize(self, clear_options, prefix)
        self._clear_options.atexit = False  # PETSc may be gone by then
        snes = PETSc.SNES().create(comm)
        snes.setOptionsPrefix(prefix)
        snes.setFromOptions()
        snes.setConvergenceHistory(reset=True)
        if "ksp_atol" not in self.options:
            snes.getKSP().setTolerances(atol=_LINEAR_ATOL_SHARE * snes.getTolerances()[1])
        return snes

    def close(self) -> None:
        """Free solver and matrices; all ranks must call it."""
        matrices = self._operator, self._single, self._jacobian.matrix
        for part in (self.snes, *matrices, self._b, self._x):
            part.destroy()
        self._two_level = None
        self._clear_options()
        PETSc.garbage_cleanup(self._problem.domain.comm)

    # --- solving -------------------------------------------------------------------------------

    def solve(self) -> SolveReport:
        """Find the equilibrium of the problem's present step.

        The problem's displacement is the initial guess and the result; on failure the caller
        resets the state. Where Newton's method fails with a lagged tangent, it is tried with a new
        one in each iteration; if this fails, too, with regularized contact, from whose result the
        unregularized law is solved.
        """
        u, contact = self._problem.u.x.array, self._problem.contact
        guess = u.copy()
        tries = [self._solve()]
        with ExitStack() as context:
            if not tries[-1].converged and self._lagging.is_on:
                context.enter_context(self._lagging.off())
                u[:] = guess
                tries.append(self._solve())
            for width, softness in _REGULARIZATIONS:
                if tries[-1].converged:
                    break
                u[:] = guess
                with contact.regularized(width, softness):
                    tries.append(self._solve())
                if tries[-1].converged:
                    tries.append(self._solve())
        return replace(
            tries[-1],
            iterations=sum(report.iterations for report in tries),
            linear_iterations=sum(report.linear_iterations for report in tries),
        )

    def _solve(self) -> SolveReport:
        self._lagging.begin_solve()
        self._near.begin_solve()
        with common.Timer("tactile: solve"):
            fem_petsc.assign(self._state.u, self._x)
            self.snes.solve(None, self._x)
            self._x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
            fem_petsc.assign(self._x, self._state.u)
        reason: Any = self.snes.getConvergedReason()
        if self._two_level and reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
            self._two_level.is_set_up = False  # made where a cell was turned inside out
        return SolveReport.of(self.snes)

    def residual(self) -> np.ndarray:
        """Return this rank's residual at the present displacement, in N; zero where held."""
        fem_petsc.assign(self._state.u, self._x)
        self._assemble_residual(self.snes, self._x, self._b)
        return self._b.array.copy()

    @contextmanager
    def linearized(self) -> Iterator[LinearSolve]:
        """Provide the solver of linear equations with the Jacobian at the present displacement.

        Raises
        ------
        TactileError
            The linear solver does not converge.
        """
        self._take_displacement()
        solution, field = self._x.duplicate(), fem.Function(self._state.u.function_space)
        with self._jacobian.restored(), self._linear_solver() as ksp:
            self._jacobian.assemble_bulk(self._bulk)
            self._jacobian.assemble_contact()
            if not (self._two_level and self._two_level.is_set_up):
                self._set_up()

            def solve(right: np.ndarray) -> np.ndarray:
                self._b.array[:] = right
                with common.Timer("tactile: solve"):
                    return solve_linear(ksp, self._b, solution, field)

            try:
                yield solve
            finally:
                solution.destroy()

    @contextmanager
    def _linear_solver(self) -> Iterator[PETSc.KSP]:
        """Provide GMRES with the operator and the preconditioner as they are."""
        pc = self.snes.getKSP().getPC()
        pc.setReusePreconditioner(True)
        ksp = PETSc.KSP().create(self.snes.comm)
        ksp.setType("fgmres")
        ksp.setPC(pc)
        ksp.setOperators(self._operator)
        ksp.setTolerances(rtol=_LINEAR_RTOL, atol=0.0, max_it=_LINEAR_MAX_IT)
        try:
            yield ksp
        finally:
            ksp.destroy()

    # --- from step to step -----------------------------------------------------------------------

    def end_step(self) -> None:
        """Make the preconditioner, and the tangent if the step made none, at the converged state.

        The next step begins with them. Made at its guess, where the contact is not known yet, they
        would slow Newton's method down.
        """
        if not self._lagging.is_of_this_solve:
            self._lagging.discard()
        with common.Timer("tactile: solve"):
            self._take_displacement()
            self._assemble_tangent()
            if self._two_level:
                self._set_up()

    def to_save(self, order: NodeOrder) -> Snapshot:
        """Return what `restore` takes, as `State.to_save` does."""
        field = fem.Function(self._state.u.function_space)
        field.x.array[:] = self._tangent_at
        return {"tangent_at": order.keep(field)}

    def restore(self, saved: dict[str, np.ndarray], order: NodeOrder) -> None:
        """Make tangent and preconditioner as `end_step` left them.

        The problem is at the end of that step, reopened.
        """
        u, x = self._state.u, self._x
        accepted = u.x.array.copy()
        order.scatter(saved["tangent_at"], u)
        self._lagging.discard()
        self._take_displacement()
        self._assemble_tangent()
        u.x.array[:] = accepted
        # Through SNES, which lets its preconditioner be set up with its first Jacobian alone.
        fem_petsc.assign(u, x)
        self.snes.computeJacobian(x, self._operator, self._jacobian.matrix)

    # --- what SNES calls -------------------------------------------------------------------------

    def _take_displacement(self) -> None:
        """Make the present displacement the solver's iterate."""
        fem_petsc.assign(self._state.u, self._x)
        self._update(self._x)

    def _update(self, x: PETSc.Vec) -> None:
        """Make an iterate the present displacement, and evaluate the body's distance there."""
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        fem_petsc.assign(x, self._state.u)
        with common.Timer("tactile: obstacle"):
            if self._near.update():
                self._contact.choose(self._near.chosen)

    def _assemble_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        self._update(x)
        with common.Timer("tactile: residual"):
            with b.localForm() as with_ghosts:
                values = with_ghosts.array_w
                values[:] = 0.0
                self._bulk.add_residual(values)
                self._contact.add_residual(values)
            b.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
            # Every iterate meets the homogeneous conditions, so there is nothing to lift.
            fem_petsc.set_bc(b, self._problem.bcs, x0=x, alpha=-1.0)

    def _assemble_jacobian(
        self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat
    ) -> None:
        if self._lagging.needs_nothing(snes):
            return
        self._update(x)
        self._assemble_tangent()
        two_level = self._two_level
        if not two_level or not two_level.is_set_up or self._lagging.needs_preconditioner(snes):
            self._set_up()

    def _assemble_tangent(self) -> None:
        """Assemble the bulk's part if it is due, and the contact's."""
        with common.Timer("tactile: jacobian"):
            if self._lagging.needs_tangent(self.snes, self._state.dt_s):
                self._tangent_at[:] = self._state.u.x.array
                self._jacobian.assemble_bulk(self._bulk_of_tangent)
            self._jacobian.assemble_contact()

    def _set_up(self) -> None:
        """Fill the matrix if a preconditioner of PETSc's is made from it, and set up multigrid."""
        if not self._two_level or self._two_level.needs_entries:
            with common.Timer("tactile: jacobian"):
                self._jacobian.fill()
        if self._two_level:
            self._two_level.set_up(self._operator, self._single, self._jacobian.matrix)


def _weakly(method: Callable[..., None]) -> Callable[..., None]:
    """Return a call of a bound method that does not keep its object alive."""
    reference = weakref.WeakMethod(method)
    return lambda *arguments: reference()(*arguments)  # type: ignore[misc]
