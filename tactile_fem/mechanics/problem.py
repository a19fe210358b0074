"""The variational problem of one step: state, terms, and conditions.

The virtual work of a step is the sum of the terms'; `tactile_fem.solvers` finds its root.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, partial

import numpy as np
import ufl
from dolfinx import fem

from tactile_fem.assembly import VirtualWork
from tactile_fem.assembly.compile import jit_options
from tactile_fem.errors import MeshError
from tactile_fem.mechanics.domain import Domain, NodeOrder
from tactile_fem.mechanics.load import Load, LoadCell
from tactile_fem.mechanics.measures import check_work
from tactile_fem.mechanics.state import State
from tactile_fem.mechanics.terms.contact import Contact
from tactile_fem.mechanics.terms.hyperelasticity import Hyperelasticity
from tactile_fem.mechanics.terms.inertia import Inertia
from tactile_fem.mechanics.terms.relaxation import Relaxation
from tactile_fem.mechanics.terms.term import MakeTerm, Sum, Term
from tactile_fem.mechanics.terms.viscosity import Viscosity
from tactile_fem.mechanics.tissues import NO_LAWS, Tissues
from tactile_fem.stimulus import Friction, RigidBody
from tactile_fem.study import Solver
from tactile_fem.tissue.constants import Tissue
from tactile_fem.tissue.energies import Law

Constraints = Callable[[fem.FunctionSpace], Sequence[fem.DirichletBC]]

# Each says whether a finger has it.
KINDS = (Hyperelasticity, Relaxation, Viscosity, Inertia)


class Problem:
    """Finger pressed and stroked by a rigid body.

    Parameters
    ----------
    domain
        The distributed finger.
    constants
        Constants of the tissues.
    body, friction
        The rigid body and its law of friction, or Coulomb's coefficient.
    solver
        Discretization and held parts.
    constraints
        Makes further Dirichlet conditions on the displacement's space, such as symmetry planes.
    laws
        Own laws by the name of the tissue, in place of those of its constants.
    terms
        Make further terms of the virtual work.

    Attributes
    ----------
    state
        Displacement (P2), position of the body, and all that an accepted step leaves for the next.
    tissues
        Deformation and laws.
    bulk, contact, terms
        The terms of the tissues as one, that of the skin, and their sum.
    order
        Carries displacements to and from the mesh file's node order.
    held
        This rank's dofs (blocks) of the nodes that do not move.
    bcs
        The conditions on the displacement.
    """

    def __init__(
        self,
        domain: Domain,
        constants: Tissue,
        body: RigidBody,
        friction: float | Friction,
        solver: Solver,
        constraints: Constraints = lambda V: [],
        laws: Mapping[str, Law] = NO_LAWS,
        terms: Sequence[MakeTerm] = (),
    ) -> None:
        self.domain, self.settings = domain, solver
        dim = domain.mesh.geometry.dim
        V = fem.functionspace(domain.mesh, ("Lagrange", 2, (dim,)))
        self.state = State(V)
        self.tissues = Tissues(domain, constants, self.state, solver.bulk_degree, laws)
        bulk = [term for kind in KINDS for term in kind.of(self.tissues, solver)]
        self.bulk = Sum(self.tissues, [*bulk, *map(self._own, [*terms, *solver.own_terms()])])
        self.contact = Contact(self.bulk, body, friction, solver)
        self.terms = Sum(self.tissues, [self.bulk, self.contact])
        self.state.histories = self.terms.histories
        self.order = NodeOrder(domain, V)
        self.held = self.order.held_dofs()
        if not domain.comm.allreduce(len(self.held)):
            raise MeshError(f"solver.held = {list(solver.held)}: nothing of the mesh is held")
        self.bcs = [fem.dirichletbc(np.zeros(dim), self.held, V), *constraints(V)]

    def _own(self, make: MakeTerm) -> Term:
        """Return a user's own term, after a check of its virtual work."""
        term = make(self.tissues)
        for form in (term.residual(self.test), term.work_of_tangent(self.test)):
            check_work(form, self.test, type(term).__name__)
        return term

    @property
    def u(self) -> fem.Function:
        """The displacement, mm."""
        return self.state.u

    @property
    def unknowns(self) -> int:
        """Number of displacement components of the whole finger, including fixed ones."""
        dofmap = self.u.function_space.dofmap
        return dofmap.index_map_bs * dofmap.index_map.size_global

    @cached_property
    def test(self) -> ufl.Argument:
        """The test function."""
        return ufl.TestFunction(self.u.function_space)

    def begin_step(
        self,
        translation: np.ndarray,
        dt_s: float,
        rotation: np.ndarray | None = None,
        swing: np.ndarray | None = None,
    ) -> None:
        """Move body and bone, `dt_s` after the last accepted step; see `State.move`."""
        self.state.move(translation, rotation, swing)
        self.state.time_step.value = dt_s
        self.terms.begin_step()

    @contextmanager
    def reopened(self) -> Iterator[None]:
        """Return to the end of the last accepted step, before it was accepted, within the context.

        There its residual vanishes again.
        """
        with self.state.reopened():
            self.terms.begin_step()
            yield

    @cached_property
    def bulk_work(self) -> VirtualWork:
        """The tissues' virtual work."""
        return self.virtual_work(self.bulk.residual(self.test), is_symmetric=self.bulk.is_symmetric)

    def virtual_work(
        self, form: ufl.Form, *, is_symmetric: bool = False, has_tangent: bool = True
    ) -> VirtualWork:
        """Return a work of the step, or part of it, for assembly in several cells at once."""
        return VirtualWork(
            form,
            self.u,
            self.test,
            is_symmetric=is_symmetric,
            has_tangent=has_tangent,
            jit_options=jit_options(self.settings.compiler_flags),
            entity_maps=self.contact.obstacle.entity_maps,
        )

    @cached_property
    def load_cell(self) -> LoadCell:
        """Evaluates the load on the finger; compiled when first used."""
        compiled = partial(self.virtual_work, has_tangent=False)
        return LoadCell(self.bulk, self.contact, self.held, self.bcs, self.bulk_work, compiled)

    def load(self) -> Load:
        """Return forces and energies at the present displacement, before it is accepted.

        Afterwards friction would be that of a step without motion; see `reopened`.
        """
        return self.load_cell.read()
