"""The variational problem of one step: layered finger against a rigid body, solved by SNES."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem, mesh
from dolfinx.fem import petsc as fem_petsc
from ufl.core.expr import Expr

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES
from tactile_fem.mechanics import multigrid
from tactile_fem.mechanics.compile import jit_options
from tactile_fem.mechanics.contact import Contact
from tactile_fem.mechanics.domain import Domain, NodeOrder
from tactile_fem.mechanics.multigrid import MULTIGRID_OPTIONS
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.stimulus.body import RigidBody
from tactile_fem.study import Elastic, Polynomial, Solver, Tissue
from tactile_fem.tissue.energies import law_of, shear_modulus, stress, young_modulus

PetscOption = str | int | float | bool
PREFIX = "tactile_"
_FROM_ENVIRONMENT: dict[str, PetscOption] = dict(PETSc.Options(PREFIX).getAll())
PETSC_DEFAULTS: dict[str, PetscOption] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "bt",
    "snes_linesearch_order": 1,
    "snes_atol": 1e-8,
    "snes_rtol": 1e-14,
    "snes_stol": 0.0,
    "snes_max_it": 25,
    "snes_error_if_not_converged": False,
    "ksp_type": "fgmres",
    "snes_ksp_ew": True,
    "snes_ksp_ew_rtol0": 0.05,
    "snes_ksp_ew_rtolmax": 0.05,
    "snes_max_linear_solve_fail": 1000,
    "ksp_max_it": 25,
    **MULTIGRID_OPTIONS,
}


Constraints = Callable[[fem.FunctionSpace], Sequence[fem.DirichletBC]]


@dataclass(frozen=True)
class SolveReport:
    """How one nonlinear solve ended."""

    converged: bool
    iterations: int
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
        self._tissue = tissue
        self._rate = fem.Constant(msh, 0.0)  # viscous time over time step
        v = ufl.TestFunction(V)

        self.order = NodeOrder(domain, V)
        self._held = self.order.held_dofs()
        if not domain.comm.allreduce(len(self._held)):
            raise MeshError(f"solver.held = {list(solver.held)}: nothing of the mesh is held")
        skin_tags = _skin_by_tissue(domain)
        facets = np.sort(skin_tags.indices)
        self.obstacle = Obstacle(body, self.u, facets, solver.contact_degree)
        dx = ufl.Measure(
            "dx",
            msh,
            subdomain_data=domain.tissue,
            metadata={"quadrature_degree": solver.bulk_degree},
        )
        ds = ufl.Measure(
            "ds",
            msh,
            subdomain_data=skin_tags,
            metadata={"quadrature_degree": solver.contact_degree},
        )
        present = domain.comm.allreduce(set(domain.tissue.values.tolist()), op=_UNION)
        bulk = sum(
            ufl.inner(self.stress(_name(tag)), ufl.grad(v)) * dx(tag) for tag in sorted(present)
        )
        contact_form = 0
        N = ufl.FacetNormal(msh)
        height = 3 * ufl.CellVolume(msh) / ufl.FacetArea(msh)
        for tag in sorted(domain.comm.allreduce(set(skin_tags.values.tolist()), op=_UNION)):
            name = _name(tag)
            E = fem.Constant(msh, young_modulus(self.constants(name)))
            contact = Contact(
                self.obstacle,
                fem.Constant(msh, friction),
                fem.Constant(msh, solver.nitsche_gamma) * E / height,
                solver.nitsche_theta,
            )
            t = self.stress(name) * N
            contact_form += contact.residual(t, self.u, self.u_old, v) * ds(tag)
        jit = jit_options(solver.compiler_flags)
        maps = self.obstacle.entity_maps
        self._contact_form = fem.form(contact_form, jit_options=jit, entity_maps=maps)
        residual = bulk + contact_form
        self.options = _set_options(solver.petsc)
        self._bcs = [fem.dirichletbc(np.zeros(3), self._held, V), *constraints(V)]
        self._problem = fem_petsc.NonlinearProblem(
            residual,
            self.u,
            bcs=self._bcs,
            petsc_options_prefix=PREFIX,
            jit_options=jit,
            entity_maps=maps,
        )
        self.snes.setFromOptions()
        pc = self.snes.getKSP().getPC()
        if pc.getType() == "mg":
            multigrid.set_up(pc, V, self._held, self.order.lines())
        self.snes.setFunction(self._assemble_residual, self._problem.b)
        self.snes.setJacobian(self._assemble_jacobian, self._problem.A)

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        return self._problem.solver

    def stress(self, tissue: str) -> Expr:
        """Return the first Piola stress of a tissue, elastic and viscous, in MPa.

        The viscous part is Kelvin-Voigt's: ``S = 2 G tau (E - E_old)/dt`` with the tissue's
        small-strain shear modulus `G`.
        """
        F = deformation_gradient(self.u)
        F_old = deformation_gradient(self.u_old)
        constants = self.constants(tissue)
        P = stress(law_of(constants, self._wrap), F)
        if self._tissue.viscous_time_s:
            G = self._wrap(shear_modulus(constants))
            P += F * (G * self._rate * (F.T * F - F_old.T * F_old))
        return P

    def energy(self, tissue: str) -> Expr:
        """Return the strain energy density of a tissue, in MPa."""
        return law_of(self.constants(tissue), self._wrap).energy(deformation_gradient(self.u))

    def solve(self, translation: np.ndarray, dt_s: float) -> SolveReport:
        """Find the equilibrium with the body at `translation` (3,), `dt_s` after the last one.

        `u` is the initial guess and the result; on failure the caller resets it.
        """
        self.obstacle.translation.value[:] = translation
        self._rate.value = self._tissue.viscous_time_s / dt_s
        with common.Timer("tactile: solve"):
            self._problem.solve()
        reason = self.snes.getConvergedReason()
        return SolveReport(
            reason > 0,
            self.snes.getIterationNumber(),
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

    def constants(self, tissue: str) -> Polynomial | Elastic:
        """Return the constants of a tissue."""
        return getattr(self._tissue, tissue)

    def _wrap(self, value: float) -> fem.Constant:
        return fem.Constant(self.domain.mesh, float(value))

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


def _set_options(wanted: dict[str, PetscOption]) -> dict[str, PetscOption]:
    """Put defaults, then the study's options, then PETSC_OPTIONS' into PETSc's database.

    They stay there, since multigrid reads its own at the first solve; those of an earlier
    problem go. Returns what is in force.
    """
    database = PETSc.Options(PREFIX)
    for name in database.getAll():
        del database[name]
    options = {**PETSC_DEFAULTS, **wanted, **_FROM_ENVIRONMENT}
    for name, value in options.items():
        database[name] = value
    whole = PETSc.Options()
    if not whole.hasName("options_left"):
        whole["options_left"] = False  # a press without contact uses few of them
    return options


def deformation_gradient(u: Expr) -> Expr:
    """Return ``F = I + grad u``."""
    return ufl.Identity(3) + ufl.grad(u)


_UNION = MPI.Op.Create(lambda a, b, _: a | b, commute=True)
_REASONS = {
    value: name.lower().replace("_", " ")
    for name, value in vars(PETSc.SNES.ConvergedReason).items()
    if isinstance(value, int)
}


def _name(tag: int) -> str:
    return next(name for name, value in TISSUES.items() if value == tag)


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
