"""The variational problem of one step: layered finger against a rigid body, solved by SNES."""

from __future__ import annotations

import atexit
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.errors import MeshError
from tactile_fem.mechanics import multigrid
from tactile_fem.mechanics.compile import jit_options
from tactile_fem.mechanics.domain import Domain, NodeOrder
from tactile_fem.mechanics.elasticity import NO_LAWS, Elasticity
from tactile_fem.mechanics.inertia import Inertia
from tactile_fem.mechanics.load import Load, LoadCell
from tactile_fem.mechanics.near_skin import NearForm, NearSkin
from tactile_fem.mechanics.newton import (
    SolveReport,
    contact_is_found,
    linear_solver,
    next_step_converges,
    weakly,
)
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.mechanics.petsc_options import (
    clear_options,
    options_of,
    products_by_blas,
    set_options,
)
from tactile_fem.mechanics.skin import Rounding, parts_of_skin
from tactile_fem.mechanics.slip import StickMemory
from tactile_fem.mechanics.state import State
from tactile_fem.mechanics.tangent import Tangent
from tactile_fem.stimulus import RigidBody, make_body
from tactile_fem.study import Solver, Study, Tissue
from tactile_fem.tissue.energies import Law

# Where Newton's method fails: how much wider contact sets in, how soft friction is.
_GENTLER = ((1.0, 0.3), (4.0, 0.3))

# Steps that begin with the same tangent and preconditioner; then the contact zone has moved on.
_STEPS = 2

# Share of the residual that ends Newton's method, at which any linear solve may end (Kelley 1995).
_LAST_SOLVE = 0.3

# Problems on several ranks, until they are closed, in the order in which they were made.
_OPEN: dict[FingerProblem, None] = {}

Constraints = Callable[[fem.FunctionSpace], Sequence[fem.DirichletBC]]


class FingerProblem:
    """Finger pressed and stroked by a rigid body.

    Parameters
    ----------
    domain
        The distributed finger.
    tissue
        Constants of the tissues.
    laws
        Own laws by the name of the tissue, in place of those of its constants.
    body, friction
        The rigid body and Coulomb's coefficient.
    solver
        Discretization of the contact, held parts, PETSc options.
    constraints
        Makes further Dirichlet conditions on the displacement's space, such as symmetry planes.

    Attributes
    ----------
    state
        Displacement (P2), place of the body, and all that an accepted step leaves for the next.
    elasticity
        Stress and energy of the tissues.
    inertia
        Of their mass; None if the finger is in equilibrium at every moment.
    obstacle
        The rigid body as the contact sees it.
    order
        Carries displacements to and from the mesh file's node order.
    held
        This rank's dofs (blocks) of the nodes that do not move.
    bcs
        The conditions on the displacement, those of symmetry planes among them.
    skin
        The parts of the skin that may touch, with their contact laws.
    options
        PETSc's options without the prefix.
    before_accept
        Called with each converged state before it becomes the old one.
    """

    def __init__(
        self,
        domain: Domain,
        tissue: Tissue,
        body: RigidBody,
        friction: float,
        solver: Solver,
        constraints: Constraints = lambda V: [],
        laws: Mapping[str, Law] = NO_LAWS,
    ) -> None:
        msh = domain.mesh
        self.domain = domain
        V = fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))
        self.state = state = State(V)
        self.elasticity = Elasticity(
            domain,
            tissue,
            state.u,
            state.u_old,
            solver.bulk_degree,
            solver.locking_ratio,
            laws,
        )
        self.inertia: Inertia | None = None
        if solver.inertia:
            self.inertia = Inertia(state, tissue.density_kg_m3, self.elasticity.measure())
        self.order = NodeOrder(domain, V)
        self.held = self.order.held_dofs()
        if not domain.comm.allreduce(len(self.held)):
            raise MeshError(f"solver.held = {list(solver.held)}: nothing of the mesh is held")
        self.before_accept: list[Callable[[], None]] = []
        facets = domain.skin_by_tissue()
        self.obstacle = Obstacle(body, state, np.sort(facets.indices), solver.contact_degree)
        stick = StickMemory(self.obstacle)
        self._rounding = Rounding.of(msh, solver.contact_width_MPa)
        self.skin = parts_of_skin(
            facets,
            self.elasticity,
            self.obstacle,
            friction,
            self._rounding,
            stick.old,
            solver,
            self.inertia,
        )
        self._age = -1  # of tangent and preconditioner, in steps
        self._jit = jit_options(solver.compiler_flags)
        stick.compile(self.skin, state.u_old, self.compile)
        self._near = NearSkin(self.obstacle, facets, self.skin, self.compile)
        state.histories.append(stick)
        if self.elasticity.relaxation:
            state.histories.append(self.elasticity.relaxation)
        if self.inertia:
            state.histories.append(self.inertia)
        self.options = options_of(solver)
        self.bcs = [fem.dirichletbc(np.zeros(msh.geometry.dim), self.held, V), *constraints(V)]
        # Around an inner solver (NGMRES, Anderson) the outer iteration solves nothing linear.
        has_inner = "npc_snes_type" in self.options
        uses_multigrid = self.options["pc_type"] == "mg" and not has_inner
        self._problem = self._nonlinear_problem("baij" if uses_multigrid else None, solver)
        self._two_level: multigrid.TwoLevel | None = None
        if uses_multigrid:
            blocks = self.order.blocks()
            self._two_level = multigrid.TwoLevel(self.snes, V, self.held, blocks)
        # By weak references: Python's garbage collector cannot see what PETSc holds. A problem that
        # PETSc held would never be freed, and MPI allows only some 2,000 communicators.
        residual_of = weakly(self._assemble_residual)
        jacobian_of = weakly(self._assemble_jacobian)
        for snes in [self.snes, *([self.snes.getNPC()] if has_inner else [])]:
            snes.setFunction(residual_of, self._problem.b)
            snes.setJacobian(jacobian_of, self._problem.A)
        if domain.comm.size > 1:
            _OPEN[self] = None

    def _nonlinear_problem(self, matrix: str | None, solver: Solver) -> fem_petsc.NonlinearProblem:
        """Return the virtual work of tissues and contact as a problem for SNES."""
        state, v = self.state, ufl.TestFunction(self.u.function_space)
        tissues, contact = self.elasticity.residual(v), ufl.Form([])
        if self.inertia:
            tissues += self.inertia.residual(v)
        for part in self.skin:
            contact += part.contact.residual(part.t, state.u, state.u_old, v) * part.ds
        self._exact_form = tangent = ufl.derivative(tissues, state.u)
        if solver.tangent_iterations > 1:
            tangent = self.elasticity.tangent(v)
            if self.inertia:
                tangent += ufl.derivative(self.inertia.residual(v), state.u)
        prefix = set_options(self.options, self.domain.comm)
        self._clear_options = weakref.finalize(self, clear_options, prefix)
        self._clear_options.atexit = False  # PETSc may be gone by then
        with products_by_blas():
            problem = fem_petsc.NonlinearProblem(
                tissues,
                state.u,
                J=tangent,
                bcs=self.bcs,
                petsc_options_prefix=prefix,
                kind=matrix,
                jit_options=self._jit,
                entity_maps=self.obstacle.entity_maps,
            )
        snes = problem.solver
        snes.setFromOptions()
        snes.setConvergenceHistory(reset=True)
        if "ksp_atol" not in self.options:
            snes.getKSP().setTolerances(atol=_LAST_SOLVE * snes.getTolerances()[1])
        self._contact = self._near_form(contact)
        self._tangent = Tangent(
            problem.J,
            self._near_form(ufl.derivative(contact, state.u)),
            self.bcs,
            solver.tangent_iterations,
        )
        return problem

    @classmethod
    def of(cls, study: Study, domain: Domain) -> FingerProblem:
        """Return the problem that a study states, on its finger."""
        stimulus = study.stimulus
        body = make_body(stimulus)
        return cls(domain, study.tissue, body, stimulus.friction, study.solver)

    @property
    def u(self) -> fem.Function:
        """The displacement, mm."""
        return self.state.u

    def close(self) -> None:
        """Free solver and matrices; all ranks must call it. `state` stays.

        On one rank an unused problem is freed by Python. Several ranks must destroy a solver
        together, but each collects its garbage at its own time: there a problem stays until it is
        closed.
        """
        own = self._problem
        for part in (own.solver, own.A, own.b, own.x):
            part.destroy()
        self._tangent.destroy()
        self._two_level = None
        self._clear_options()
        PETSc.garbage_cleanup(self.domain.comm)
        _OPEN.pop(self, None)

    @property
    def unknowns(self) -> int:
        """Number of displacement components of the whole finger, including fixed ones."""
        dofmap = self.u.function_space.dofmap
        return dofmap.index_map_bs * dofmap.index_map.size_global

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        return self._problem.solver

    @cached_property
    def load_cell(self) -> LoadCell:
        """Evaluates the load on the finger; compiled when first used."""
        return LoadCell(
            self.state,
            self.elasticity,
            self.obstacle,
            self.skin,
            self._problem.F,
            self.held,
            self.compile,
            self.inertia,
        )

    @cached_property
    def _exact_tangent(self) -> fem.Form:
        """The residual's derivative, which sensitivities need; compiled when first used."""
        return self.compile(self._exact_form)

    def load(self) -> Load:
        """Return forces and energies at the present displacement."""
        return self.load_cell.read()

    def compile(self, form: ufl.Form) -> fem.Form:
        """Compile a form that may use the obstacle."""
        maps = self.obstacle.entity_maps
        return fem.form(form, jit_options=self._jit, entity_maps=maps)

    def _near_form(self, form: ufl.Form) -> NearForm:
        return NearForm(form, self._near, self.obstacle, self._jit)

    def solve(self, translation: np.ndarray, dt_s: float) -> SolveReport:
        """Find the equilibrium with the body at `translation` (3,), `dt_s` after the last one.

        `u` is the initial guess and the result; on failure the caller resets the state. Where
        Newton's method fails with a tangent that is kept, it is made anew in every iteration;
        where it fails then, contact sets in more gently and friction is softer at first, and the
        law as it should be follows from there.
        """
        self._go_to(translation, dt_s)
        guess = self.u.x.array.copy()
        tries = [self._newton()]
        with self._tangent.renewed():
            if not tries[-1].converged and self._tangent.is_kept:
                self.u.x.array[:] = guess
                tries.append(self._newton())
            for width, softness in _GENTLER:
                if tries[-1].converged:
                    break
                self.u.x.array[:] = guess
                with self._rounding.gentler(width, softness):
                    tries.append(self._newton())
                if tries[-1].converged:
                    tries.append(self._newton())
        return replace(
            tries[-1],
            iterations=sum(report.iterations for report in tries),
            linear_iterations=sum(report.linear_iterations for report in tries),
        )

    def _go_to(self, translation: np.ndarray, dt_s: float) -> None:
        """Move the body to `translation`, `dt_s` after the last step."""
        self.state.translation.value[:] = translation
        self.state.dt_s = dt_s
        self.elasticity.set_time_step(dt_s)
        if self.inertia:
            self.inertia.set_time_step(dt_s)

    def _newton(self) -> SolveReport:
        self._tangent.begin_solve()
        self._near.begin_solve()
        with common.Timer("tactile: solve"):
            self._problem.solve()
        return SolveReport.of(self.snes)

    def residual(self) -> np.ndarray:
        """Return this rank's residual at the present displacement, in N; zero where held."""
        own = self._problem
        fem_petsc.assign(self.u, own.x)
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
        self._tangent.assemble_exactly(own.A, self._exact_tangent)
        if self._two_level and not self._two_level.is_set_up:  # no step took an iteration yet
            self._two_level.set_up(own.A)
        solution, field = own.x.duplicate(), fem.Function(self.u.function_space)
        with linear_solver(self.snes, own.A) as solve_with:

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

    def accept(self, load: Load | None = None) -> Load:
        """Make the present state the history of the next step; return its load.

        After every second step tangent and preconditioner are made at the converged state, and
        the next two steps begin with them; the second of these with the tangent that the first
        had renewed. Made at the guess, where the contact is not known yet, they slow Newton's
        method down.

        Parameters
        ----------
        load
            At the present state, if `load` has been called there; read here otherwise.
        """
        load = load or self.load()
        iterations = self.snes.getIterationNumber()
        if iterations:
            with common.Timer("tactile: solve"):
                self._prepare_next_step()
        for follow in self.before_accept:
            follow()
        self.state.accept(load.force_N, load.friction_N, iterations)
        return load

    @property
    def is_resumable(self) -> bool:
        """Whether the next step begins with what follows from the accepted state alone.

        Then, restored from this state, the problem takes the same iterations as it would have.
        """
        return self._age <= 0

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Restore what `state.gather` returned, and the next step's preconditioner."""
        self._age = -1
        self.state.restore(saved, self.order, self._prepare)

    def _prepare_next_step(self) -> None:
        """Make tangent and preconditioner at the present, converged displacement if it is time."""
        self._age = (self._age + 1) % _STEPS
        if self._age > 0:
            return
        A = self._problem.A
        self._look_around()
        with common.Timer("tactile: jacobian"):
            self._tangent.expire()
            self._tangent.assemble(A, self.state.dt_s)
        if self._two_level:
            self._two_level.set_up(A)

    def _prepare(self, translation: np.ndarray, dt_s: float) -> None:
        """Make the tangent and the preconditioner that `accept` made."""
        self._age = 0
        self._go_to(translation, dt_s)
        fem_petsc.assign(self.u, self._problem.x)
        self._tangent.expire()
        # Through SNES, which lets its preconditioner be set up with its first Jacobian alone.
        self.snes.computeJacobian(self._problem.x, self._problem.A)

    def _look_around(self) -> None:
        """Take the present displacement as the solver's iterate, and see the body from there."""
        fem_petsc.assign(self.u, self._problem.x)
        self._update(self._problem.x)

    def _update(self, x: PETSc.Vec) -> None:
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        fem_petsc.assign(x, self.u)
        with common.Timer("tactile: obstacle"):
            self.obstacle.refresh()
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
            fem_petsc.set_bc(b, self.bcs, x0=x, alpha=-1.0)

    def _assemble_jacobian(
        self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat
    ) -> None:
        if next_step_converges(snes):
            return  # with the Jacobian of the last iterate
        self._update(x)
        with common.Timer("tactile: jacobian"):
            found = contact_is_found(snes)
            self._tangent.assemble(P, self.state.dt_s, contact_is_found=found)
        if self._two_level:
            self._two_level.follow(P)


@atexit.register
def _close_all() -> None:
    """Close open problems at exit, in the same order on all ranks: destruction is collective."""
    for problem in list(_OPEN):
        problem.close()
