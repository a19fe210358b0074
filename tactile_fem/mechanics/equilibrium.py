"""Equilibrium of tissues and contact as SNES sees it: residual, Jacobian and preconditioner."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.mechanics import multigrid
from tactile_fem.mechanics.compile import jit_options
from tactile_fem.mechanics.domain import NodeOrder
from tactile_fem.mechanics.jacobian import Jacobian
from tactile_fem.mechanics.near_skin import NearForm, NearSkin
from tactile_fem.mechanics.newton import (
    SolveReport,
    contact_is_found,
    linear_solver,
    next_step_converges,
    struggles,
    weakly,
)
from tactile_fem.mechanics.petsc_options import clear_options, options_of, set_options
from tactile_fem.mechanics.state import State
from tactile_fem.mechanics.tangent import Tangent
from tactile_fem.study import Solver

# Steps that begin with the same tangent and preconditioner; then the contact zone has moved on.
_STEPS = 2

# Share of the residual that ends Newton's method, at which any linear solve may end (Kelley 1995).
_LAST_SOLVE = 0.3


@dataclass(frozen=True)
class VirtualWork:
    """The residual and its derivatives in UFL.

    Attributes
    ----------
    tissues, contact
        The two parts of the residual.
    tangent
        Derivative of the tissues' part, as Newton's method keeps it for some iterations.
    exact_tangent
        The same at all of the residual's points.
    is_symmetric
        Whether they are.
    """

    tissues: ufl.Form
    contact: ufl.Form
    tangent: ufl.Form
    exact_tangent: ufl.Form
    is_symmetric: bool


class Equilibrium:
    """The nonlinear equations of one step and their solver.

    Parameters
    ----------
    work
        Their residual.
    state
        Its displacement is the unknown.
    bcs, held
        Conditions on it; this rank's dofs (blocks) of the nodes that do not move.
    order
        Names the lines of nodes for multigrid's smoother.
    near
        The skin that the body is near.
    solver
        PETSc's options, the compiler's flags, how long the tissues' tangent is kept.

    Attributes
    ----------
    options
        PETSc's options without the prefix.
    """

    def __init__(
        self,
        work: VirtualWork,
        state: State,
        bcs: Sequence[fem.DirichletBC],
        held: np.ndarray,
        order: NodeOrder,
        near: NearSkin,
        solver: Solver,
    ) -> None:
        self._work, self._state, self._bcs, self._near = work, state, bcs, near
        self._jit = jit_options(solver.compiler_flags)
        self.options = options_of(solver)
        # Around an inner solver (NGMRES, Anderson) the outer iteration solves nothing linear.
        has_inner = "npc_snes_type" in self.options
        uses_multigrid = self.options["pc_type"] == "mg" and not has_inner
        self._problem = self._nonlinear_problem("baij" if uses_multigrid else None)
        self._contact = NearForm(work.contact, near, self._jit)
        contact_tangent = NearForm(ufl.derivative(work.contact, state.u), near, self._jit)
        self._jacobian = Jacobian(
            self._problem.J,
            contact_tangent,
            bcs,
            self._problem.A,
            self._jit,
            is_symmetric=work.is_symmetric,
        )
        self._tangent = Tangent(self._jacobian, solver.tangent_iterations)
        self._age = -1  # of tangent and preconditioner, in steps
        self._two_level: multigrid.TwoLevel | None = None
        self._operator = self._problem.A
        if uses_multigrid:
            V = state.u.function_space
            self._operator = self._jacobian.operator()
            self._two_level = multigrid.TwoLevel(self.snes, V, held, order.blocks())
        # By weak references: Python's garbage collector cannot see what PETSc holds. A problem that
        # PETSc held would never be freed, and MPI allows only some 2,000 communicators.
        residual_of = weakly(self._assemble_residual)
        jacobian_of = weakly(self._assemble_jacobian)
        for snes in [self.snes, *([self.snes.getNPC()] if has_inner else [])]:
            snes.setFunction(residual_of, self._problem.b)
            snes.setJacobian(jacobian_of, self._operator, self._problem.A)

    def _nonlinear_problem(self, matrix: str | None) -> fem_petsc.NonlinearProblem:
        """Return the tissues' part as a problem for SNES; the contact's is added in each call."""
        u = self._state.u
        prefix = set_options(self.options, u.function_space.mesh.comm)
        self._clear_options = weakref.finalize(self, clear_options, prefix)
        self._clear_options.atexit = False  # PETSc may be gone by then
        problem = fem_petsc.NonlinearProblem(
            self._work.tissues,
            u,
            J=self._work.tangent,
            bcs=self._bcs,
            petsc_options_prefix=prefix,
            kind=matrix,
            jit_options=self._jit,
            entity_maps=self._near.obstacle.entity_maps,
        )
        snes = problem.solver
        snes.setFromOptions()
        snes.setConvergenceHistory(reset=True)
        if "ksp_atol" not in self.options:
            snes.getKSP().setTolerances(atol=_LAST_SOLVE * snes.getTolerances()[1])
        return problem

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        return self._problem.solver

    @property
    def tissues(self) -> fem.Form:
        """The compiled residual of the tissues alone."""
        return self._problem.F

    def close(self) -> None:
        """Free solver and matrices; all ranks must call it."""
        own = self._problem
        for part in (own.solver, self._operator, own.A, own.b, own.x):
            part.destroy()
        self._two_level = None
        self._clear_options()

    # --- solving -------------------------------------------------------------------------------

    def solve(self) -> SolveReport:
        """Run Newton's method from the present displacement, which becomes the result."""
        self._tangent.begin_solve()
        self._near.begin_solve()
        with common.Timer("tactile: solve"):
            self._problem.solve()
        return SolveReport.of(self.snes)

    @property
    def keeps_tangent(self) -> bool:
        """Whether iterations share a tangent of the tissues."""
        return self._tangent.is_kept

    def renewed_tangents(self) -> AbstractContextManager[None]:
        """Assemble the tissues' tangent in every iteration within the context."""
        return self._tangent.renewed()

    def residual(self) -> np.ndarray:
        """Return this rank's residual at the present displacement, in N; zero where held."""
        own = self._problem
        fem_petsc.assign(self._state.u, own.x)
        self._assemble_residual(self.snes, own.x, own.b)
        return own.b.array.copy()

    @contextmanager
    def linearized(self) -> Iterator[Callable[[np.ndarray], np.ndarray]]:
        """Provide the solver of linear equations with the Jacobian at the present displacement.

        It takes this rank's right-hand side and returns the solution as `state.u` holds it.

        Raises
        ------
        TactileError
            By the solver: it does not converge.
        """
        own = self._problem
        self._look_around()
        solution, field = own.x.duplicate(), fem.Function(self._state.u.function_space)
        with self._jacobian.kept_tissues(), linear_solver(self.snes, self._operator) as solve_with:
            self._jacobian.assemble_tissues(self._exact_tangent)
            self._jacobian.assemble_contact()
            if not (self._two_level and self._two_level.is_set_up):
                self._fill()

            def solve(right: np.ndarray) -> np.ndarray:
                own.b.array[:] = right
                with common.Timer("tactile: solve"):
                    solve_with(own.b, solution)
                solution.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
                fem_petsc.assign(solution, field)
                return field.x.array.copy()

            try:
                yield solve
            finally:
                solution.destroy()

    @cached_property
    def _exact_tangent(self) -> fem.Form:
        """The tissues' tangent that sensitivities need; compiled when first used."""
        maps = self._near.obstacle.entity_maps
        return fem.form(self._work.exact_tangent, jit_options=self._jit, entity_maps=maps)

    # --- what the next step begins with ----------------------------------------------------------

    @property
    def is_resumable(self) -> bool:
        """Whether the next step begins with what follows from the accepted state alone."""
        return self._age <= 0

    def end_step(self) -> None:
        """Make tangent and preconditioner at the present, converged displacement if it is time.

        Two steps begin with them, the second with the tangent that the first has renewed. Made at
        the guess, where the contact is not known yet, they slow Newton's method down.
        """
        self._age = (self._age + 1) % _STEPS
        if self._age > 0:
            return
        with common.Timer("tactile: solve"):
            self._look_around()
            with common.Timer("tactile: jacobian"):
                self._tangent.expire()
                self._tangent.assemble(self._state.dt_s)
            if self._two_level:
                self._fill()

    def forget(self) -> None:
        """Be as if no step had been solved yet."""
        self._age = -1

    def restore(self) -> None:
        """Make tangent and preconditioner as `end_step` made them at the present displacement."""
        self._age = 0
        fem_petsc.assign(self._state.u, self._problem.x)
        self._tangent.expire()
        # Through SNES, which lets its preconditioner be set up with its first Jacobian alone.
        self.snes.computeJacobian(self._problem.x, self._operator, self._problem.A)

    # --- what SNES calls -------------------------------------------------------------------------

    def _look_around(self) -> None:
        """Take the present displacement as the solver's iterate, and see the body from there."""
        fem_petsc.assign(self._state.u, self._problem.x)
        self._update(self._problem.x)

    def _update(self, x: PETSc.Vec) -> None:
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        fem_petsc.assign(x, self._state.u)
        with common.Timer("tactile: obstacle"):
            self._near.obstacle.refresh()
            self._near.update()

    def _assemble_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        del snes
        self._update(x)
        with common.Timer("tactile: residual"):
            with b.localForm() as with_ghosts:
                with_ghosts.set(0.0)
            fem_petsc.assemble_vector(b, self._problem.F)
            fem_petsc.assemble_vector(b, self._contact())
            b.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
            # Every iterate meets the homogeneous conditions, so there is nothing to lift.
            fem_petsc.set_bc(b, self._bcs, x0=x, alpha=-1.0)

    def _assemble_jacobian(
        self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat
    ) -> None:
        del J, P
        if next_step_converges(snes):
            return  # with the Jacobian of the last iterate
        self._update(x)
        with common.Timer("tactile: jacobian"):
            self._tangent.assemble(
                self._state.dt_s,
                contact_is_found=contact_is_found(snes),
                is_outdated=struggles(snes),
            )
        if not self._two_level or self._two_level.is_outdated:
            self._fill()

    def _fill(self) -> None:
        """Fill the matrix from which preconditioners are made, and set up multigrid with it."""
        with common.Timer("tactile: jacobian"):
            self._jacobian.fill()
        if self._two_level:
            self._two_level.set_up(self._operator, self._problem.A)
