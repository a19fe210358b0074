"""The variational problem of one step: layered finger against a rigid body, solved by SNES."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem, mesh
from dolfinx.fem import petsc as fem_petsc
from ufl.core.expr import Expr

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.mechanics import multigrid
from tactile_fem.mechanics.compile import jit_options
from tactile_fem.mechanics.contact import Contact
from tactile_fem.mechanics.domain import Domain, NodeOrder
from tactile_fem.mechanics.elasticity import Elasticity
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.mechanics.petsc_options import PREFIX, set_options
from tactile_fem.stimulus.body import RigidBody
from tactile_fem.study import Solver, Tissue
from tactile_fem.tissue.energies import young_modulus

logger = logging.getLogger(__name__)

# How much wider contact sets in where Newton's method fails.
_GENTLER = 4.0

Constraints = Callable[[fem.FunctionSpace], Sequence[fem.DirichletBC]]


@dataclass(frozen=True)
class SolveReport:
    """How one nonlinear solve ended.

    Attributes
    ----------
    iterations, linear_iterations
        Of Newton's method, and of the linear solver in all of them.
    """

    converged: bool
    iterations: int
    linear_iterations: int
    residual_N: float
    reason: str


@dataclass(frozen=True)
class Load:
    """Forces of one accepted step, on the finger.

    Attributes
    ----------
    force_N, moment_Nmm
        Of the contact traction, (3,); the moment about the origin.
    imbalance_N
        Distance between the contact force and the reaction at the held boundary.
    """

    force_N: np.ndarray
    moment_Nmm: np.ndarray
    imbalance_N: float


class FingerProblem:
    """Finger pressed and stroked by a rigid body.

    Parameters
    ----------
    domain
        The distributed finger.
    tissue
        Constants of the tissues.
    body, friction
        The rigid body and Coulomb's coefficient.
    solver
        Discretization of the contact, held parts, PETSc options.
    constraints
        Makes further Dirichlet conditions on the displacement's space, such as symmetry planes.

    Attributes
    ----------
    u, u_old
        Displacement (P2, mm), now and at the last accepted step.
    elasticity
        Stress and energy of the tissues.
    obstacle
        The rigid body and its place.
    order
        Carries displacements to and from the mesh file's node order.
    options
        PETSc's options without the prefix.
    """

    def __init__(
        self,
        domain: Domain,
        tissue: Tissue,
        body: RigidBody,
        friction: float,
        solver: Solver,
        constraints: Constraints = lambda V: [],
    ) -> None:
        msh = domain.mesh
        self.domain = domain
        V = fem.functionspace(msh, ("Lagrange", 2, (3,)))
        self.u = fem.Function(V, name="displacement")
        self.u_old = fem.Function(V)
        self.elasticity = Elasticity(tissue, self.u, self.u_old)
        self.order = NodeOrder(domain, V)
        self._held = self.order.held_dofs()
        if not domain.comm.allreduce(len(self._held)):
            raise MeshError(f"solver.held = {list(solver.held)}: nothing of the mesh is held")
        self._width = fem.Constant(msh, solver.contact_width_MPa)
        skin = _skin_by_tissue(domain)
        self.obstacle = Obstacle(body, self.u, np.sort(skin.indices), solver.contact_degree)
        v = ufl.TestFunction(V)
        bulk = self.elasticity.residual(domain, v, solver.bulk_degree)
        contact_form = self._contact_residual(skin, friction, solver, v)
        jit = jit_options(solver.compiler_flags)
        maps = self.obstacle.entity_maps
        self._contact_form = fem.form(contact_form, jit_options=jit, entity_maps=maps)
        self.options = set_options(solver)
        uses_multigrid = self.options["pc_type"] == "mg"
        self._bcs = [fem.dirichletbc(np.zeros(3), self._held, V), *constraints(V)]
        self._problem = fem_petsc.NonlinearProblem(
            bulk + contact_form,
            self.u,
            bcs=self._bcs,
            petsc_options_prefix=PREFIX,
            kind="baij" if uses_multigrid else None,
            jit_options=jit,
            entity_maps=maps,
        )
        self.snes.setFromOptions()
        self._two_level: multigrid.TwoLevel | None = None
        if uses_multigrid:
            blocks = self.order.blocks()
            self._two_level = multigrid.TwoLevel(self.snes, V, self._held, blocks)
        self.snes.setFunction(self._assemble_residual, self._problem.b)
        self.snes.setJacobian(self._assemble_jacobian, self._problem.A)

    @property
    def unknowns(self) -> int:
        """Number of displacement components of the whole finger, held ones included."""
        return 3 * self.u.function_space.dofmap.index_map.size_global

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        return self._problem.solver

    def _contact_residual(
        self, skin: mesh.MeshTags, friction: float, solver: Solver, v: Expr
    ) -> ufl.Form:
        """Return the virtual work of the contact traction in `v`."""
        msh = self.domain.mesh
        N = ufl.FacetNormal(msh)
        height = 3 * ufl.CellVolume(msh) / ufl.FacetArea(msh)
        ds = ufl.Measure(
            "ds",
            msh,
            subdomain_data=skin,
            metadata={"quadrature_degree": solver.contact_degree},
        )
        form = 0
        for tissue, tag in self.domain.tissues_of(skin).items():
            E = fem.Constant(msh, young_modulus(self.elasticity.constants(tissue)))
            contact = Contact(
                self.obstacle,
                fem.Constant(msh, friction),
                fem.Constant(msh, solver.nitsche_gamma) * E / height,
                self._width,
                solver.nitsche_theta,
            )
            t = self.elasticity.stress(tissue) * N
            form += contact.residual(t, self.u, self.u_old, v) * ds(tag)
        return form

    def solve(self, translation: np.ndarray, dt_s: float) -> SolveReport:
        """Find the equilibrium with the body at `translation` (3,), `dt_s` after the last one.

        `u` is the initial guess and the result; on failure the caller resets it. Where Newton's
        method fails, contact is made to set in more gently, and then as it should from there.
        """
        self.obstacle.translation.value[:] = translation
        self.elasticity.set_time_step(dt_s)
        guess = self.u.x.array.copy()
        width = float(self._width.value)
        tries = [self._newton()]
        if not tries[0].converged and width:
            self.u.x.array[:] = guess
            self._width.value = _GENTLER * width
            tries.append(self._newton())
            self._width.value = width
            if tries[1].converged:
                logger.debug("contact over %g MPa, then over %g MPa", _GENTLER * width, width)
                tries.append(self._newton())
        return replace(
            tries[-1],
            iterations=sum(report.iterations for report in tries),
            linear_iterations=sum(report.linear_iterations for report in tries),
        )

    def _newton(self) -> SolveReport:
        with common.Timer("tactile: solve"):
            self._problem.solve()
        reason = self.snes.getConvergedReason()
        return SolveReport(
            reason > 0,
            self.snes.getIterationNumber(),
            self.snes.getLinearSolveIterations(),
            float(self.snes.getFunctionNorm()),
            _REASONS.get(reason, str(reason)),
        )

    def accept(self) -> None:
        """Make the present state the history of the next step."""
        self.u_old.x.array[:] = self.u.x.array
        self.obstacle.translation_old.value[:] = self.obstacle.translation.value

    def load(self) -> Load:
        """Return the contact force and its balance with the reaction at the held parts."""
        with common.Timer("tactile: load"):
            self.obstacle.refresh()
            contact = self._owned(fem_petsc.assemble_vector(self._contact_form))
            whole = self._owned(fem_petsc.assemble_vector(self._problem.F))
        V = self.u.function_space
        owned = V.dofmap.index_map.size_local
        position = V.tabulate_dof_coordinates()[:owned] + self.u.x.array.reshape(-1, 3)[:owned]
        held = self._held[self._held < owned]
        local = np.stack(
            [
                -contact.sum(axis=0),
                -np.cross(position, contact).sum(axis=0),
                (whole - contact)[held].sum(axis=0),
            ]
        )
        force, moment, reaction = self.domain.comm.allreduce(local)
        return Load(force, moment, float(np.linalg.norm(force + reaction)))

    def _owned(self, vector: PETSc.Vec) -> np.ndarray:
        vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        values = vector.array.reshape(-1, 3).copy()
        vector.destroy()
        return values

    def _update(self, x: PETSc.Vec) -> None:
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        fem_petsc.assign(x, self.u)
        with common.Timer("tactile: obstacle"):
            self.obstacle.refresh()

    def _assemble_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        del snes
        self._update(x)
        with common.Timer("tactile: residual"):
            with b.localForm() as with_ghosts:
                with_ghosts.set(0.0)
            fem_petsc.assemble_vector(b, self._problem.F)
            b.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
            # Every iterate meets the homogeneous conditions, so there is nothing to lift.
            fem_petsc.set_bc(b, self._bcs, x0=x, alpha=-1.0)

    def _assemble_jacobian(
        self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat
    ) -> None:
        self._update(x)
        with common.Timer("tactile: jacobian"):
            fem_petsc.assemble_jacobian(snes, x, J, P, self.u, self._problem.J, None, self._bcs)
        if self._two_level:
            self._two_level.follow(P)


_REASONS = {
    value: name.lower().replace("_", " ")
    for name, value in vars(PETSc.SNES.ConvergedReason).items()
    if isinstance(value, int)
}


def _skin_by_tissue(domain: Domain) -> mesh.MeshTags:
    """Return the skin's facets, each tagged with its tissue."""
    msh = domain.mesh
    facets = domain.surface.find(SURFACES["skin"])
    msh.topology.create_connectivity(2, 3)
    to_cell = msh.topology.connectivity(2, 3)
    tissue = np.zeros(msh.topology.index_map(3).size_local + msh.topology.index_map(3).num_ghosts)
    tissue[domain.tissue.indices] = domain.tissue.values
    values = np.array([tissue[to_cell.links(f)[0]] for f in facets], dtype=np.int32)
    return mesh.meshtags(msh, 2, facets, values)
