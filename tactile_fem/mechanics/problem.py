"""The variational problem of one step: layered finger against a rigid body, solved by SNES."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from tactile_fem.errors import ConvergenceError, MeshError
from tactile_fem.mechanics.compile import jit_options
from tactile_fem.mechanics.domain import Domain, NodeOrder
from tactile_fem.mechanics.elasticity import NO_LAWS, Elasticity
from tactile_fem.mechanics.equilibrium import Equilibrium, VirtualWork
from tactile_fem.mechanics.inertia import Inertia
from tactile_fem.mechanics.load import Load, LoadCell
from tactile_fem.mechanics.near_skin import NearSkin
from tactile_fem.mechanics.newton import SolveReport
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.mechanics.petsc_options import PetscOption
from tactile_fem.mechanics.skin import Rounding, parts_of_skin
from tactile_fem.mechanics.slip import StickMemory
from tactile_fem.mechanics.state import State
from tactile_fem.stimulus import RigidBody
from tactile_fem.study import Solver
from tactile_fem.tissue.constants import Tissue
from tactile_fem.tissue.energies import Law

# Where Newton's method fails: how much wider contact sets in, how soft friction is.
_GENTLER = ((1.0, 0.3), (4.0, 0.3))

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
    equilibrium
        The equations of a step and their solver.
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
        self._jit = jit_options(solver.compiler_flags)
        stick.compile(self.skin, state.u_old, self.compile)
        near = NearSkin(self.obstacle, facets, self.skin, self.compile)
        state.histories.append(stick)
        if self.elasticity.relaxation:
            state.histories.append(self.elasticity.relaxation)
        if self.inertia:
            state.histories.append(self.inertia)
        self.bcs = [fem.dirichletbc(np.zeros(msh.geometry.dim), self.held, V), *constraints(V)]
        work = self._virtual_work(solver.tangent_iterations > 1)
        self.equilibrium = Equilibrium(work, state, self.bcs, self.held, self.order, near, solver)
        if domain.comm.size > 1:
            _OPEN[self] = None

    def _virtual_work(self, keeps_tangent: bool) -> VirtualWork:
        """Return the virtual work of tissues and contact."""
        state, v = self.state, ufl.TestFunction(self.u.function_space)
        tissues, contact = self.elasticity.residual(v), ufl.Form([])
        if self.inertia:
            tissues += self.inertia.residual(v)
        for part in self.skin:
            contact += part.contact.residual(part.t, state.u, state.u_old, v) * part.ds
        tangent = exact_tangent = ufl.derivative(tissues, state.u)
        if keeps_tangent:
            tangent = self.elasticity.tangent(v)
            if self.inertia:
                tangent += ufl.derivative(self.inertia.residual(v), state.u)
        # Over a step that lets them relax, stress does not derive from a potential.
        is_symmetric = self.elasticity.relaxation is None
        return VirtualWork(tissues, contact, tangent, exact_tangent, is_symmetric)

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
        self.equilibrium.close()
        PETSc.garbage_cleanup(self.domain.comm)
        _OPEN.pop(self, None)

    @property
    def unknowns(self) -> int:
        """Number of displacement components of the whole finger, including fixed ones."""
        dofmap = self.u.function_space.dofmap
        return dofmap.index_map_bs * dofmap.index_map.size_global

    @property
    def options(self) -> dict[str, PetscOption]:
        """PETSc's options without the prefix."""
        return self.equilibrium.options

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        return self.equilibrium.snes

    @cached_property
    def load_cell(self) -> LoadCell:
        """Evaluates the load on the finger; compiled when first used."""
        return LoadCell(
            self.state,
            self.elasticity,
            self.obstacle,
            self.skin,
            self.equilibrium.tissues,
            self.held,
            self.compile,
            self.inertia,
        )

    def load(self) -> Load:
        """Return forces and energies at the present displacement."""
        return self.load_cell.read()

    def compile(self, form: ufl.Form) -> fem.Form:
        """Compile a form that may use the obstacle."""
        maps = self.obstacle.entity_maps
        return fem.form(form, jit_options=self._jit, entity_maps=maps)

    def solve(self, translation: np.ndarray, dt_s: float) -> SolveReport:
        """Find the equilibrium with the body at `translation` (3,), `dt_s` after the last one.

        `u` is the initial guess and the result; on failure the caller resets the state. Where
        Newton's method fails with a tangent that is kept, it is made anew in every iteration;
        where it fails then, contact sets in more gently and friction is softer at first, and the
        law as it should be follows from there.
        """
        self._go_to(translation, dt_s)
        guess = self.u.x.array.copy()
        tries = [self.equilibrium.solve()]
        with self.equilibrium.renewed_tangents():
            if not tries[-1].converged and self.equilibrium.keeps_tangent:
                self.u.x.array[:] = guess
                tries.append(self.equilibrium.solve())
            for width, softness in _GENTLER:
                if tries[-1].converged:
                    break
                self.u.x.array[:] = guess
                with self._rounding.gentler(width, softness):
                    tries.append(self.equilibrium.solve())
                if tries[-1].converged:
                    tries.append(self.equilibrium.solve())
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

    def residual(self) -> np.ndarray:
        """Return this rank's residual at the present displacement, in N; zero where held."""
        return self.equilibrium.residual()

    def linearized(self) -> AbstractContextManager[Callable[[np.ndarray], np.ndarray]]:
        """Provide the solver of `Equilibrium.linearized`."""
        return self.equilibrium.linearized()

    def accept(self, load: Load | None = None) -> Load:
        """Make the present state the history of the next step; return its load.

        Parameters
        ----------
        load
            At the present state, if `load` has been called there; read here otherwise.

        Raises
        ------
        ConvergenceError
            The load is not finite.
        """
        load = load or self.load()
        if not load.is_finite:
            reason, place = "the load is not finite", self.state.translation.value
            raise ConvergenceError(f"a state cannot be accepted: {reason}", place, reason)
        iterations = self.snes.getIterationNumber()
        if iterations or self.state.iterations:
            self.equilibrium.end_step()
        for follow in self.before_accept:
            follow()
        self.state.accept(load.force_N, load.friction_N, iterations)
        return load

    @property
    def is_resumable(self) -> bool:
        """Whether, restored from the accepted state, the problem takes the same iterations."""
        return self.equilibrium.is_resumable

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Restore what `state.gather` returned, and the next step's preconditioner."""
        self.equilibrium.forget()
        self.state.restore(saved, self.order, self._prepare)

    def _prepare(self, translation: np.ndarray, dt_s: float) -> None:
        """Make the tangent and the preconditioner that `accept` made."""
        self._go_to(translation, dt_s)
        self.equilibrium.restore()


@atexit.register
def _close_all() -> None:
    """Close open problems at exit, in the same order on all ranks: destruction is collective."""
    for problem in list(_OPEN):
        problem.close()
