"""Nitsche's contact of the skin with the rigid body: the term, and the history of sticking skin.

Nitsche's method holds sticking skin with ``t_t - gamma_h slip``. The tissue's traction `t_t` has a
discretization error. If slip were measured from the last step only, the skin would creep by this
error in every step. As in the return mapping of plasticity, slip is therefore measured from where
the skin began to stick: the part of the traction that the contact did not transmit in the last
accepted step,

    d = t_t - s_t        (gamma_h times the elastic slip),

is subtracted in the present step. Since it is a traction, it remains valid if `gamma_h` changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np
import ufl
from dolfinx import fem
from ufl.classes import FacetJacobianDeterminant
from ufl.core.expr import Expr

from tactile_fem.assembly.compile import Constant
from tactile_fem.mechanics.contact_law import ZERO_BELOW, ContactLaw
from tactile_fem.mechanics.obstacle import Obstacle, PointValues
from tactile_fem.mechanics.state import PointHistory
from tactile_fem.mechanics.terms.term import Sum, Term
from tactile_fem.stimulus import Friction, RigidBody
from tactile_fem.stimulus.friction import field_in_plane, law_of
from tactile_fem.study import Solver

# Share of its outermost tetrahedron's height by which skin may be pulled out; the traction that
# does this would be a third of the skin's modulus.
_PULL_OUT_SHARE = 0.25
_UNLIMITED_MM = 1e6


@dataclass(frozen=True)
class SkinPart:
    """Skin of one tissue.

    Attributes
    ----------
    law
        Its contact law.
    ds
        Measure of its facets.
    reach
        Gap (mm) beyond which skin that is not compressed carries no traction.
    """

    law: ContactLaw
    ds: ufl.Measure
    reach: Expr


class Contact(Term):
    """Contact and friction between the skin and the body.

    Parameters
    ----------
    bulk
        The other terms: what they pull at the skin, and how stiff they make it.
    body, friction
        The rigid body and its law of friction, or Coulomb's coefficient.
    solver
        Discretization of the contact.

    Attributes
    ----------
    obstacle
        The rigid body in UFL.
    friction
        The law of friction; its numbers are constants.
    facets
        The skin, tagged with its tissues.
    parts
        The skin that may touch, by tissue.
    """

    def __init__(
        self, bulk: Sum, body: RigidBody, friction: float | Friction, solver: Solver
    ) -> None:
        super().__init__(bulk.tissues)
        tissues, msh = bulk.tissues, bulk.tissues.u.function_space.mesh
        self.facets = tissues.domain.skin_by_tissue()
        self.obstacle = Obstacle(body, tissues.state, np.sort(self.facets.indices), solver)
        self._solver = solver
        law, plane = law_of(friction), tissues.domain.plane
        self.friction = law.with_constants(partial(Constant, msh))
        field = law.over_body()
        self._local = field and self.obstacle.over_body(field_in_plane(field, plane))
        self._gamma = Constant(msh, solver.nitsche_gamma)
        self._width = Constant(msh, solver.contact_width_MPa)
        self._softness = Constant(msh, 0.0)
        self._untransmitted = self.obstacle.quadrature_function(tissues.u.ufl_shape)
        self.parts = self.skin(bulk.at_skin())
        untransmitted = self.at_points(lambda part: part.law.untransmitted())
        self.histories = [_Stick(self._untransmitted, self.obstacle, untransmitted)]

    def skin(self, bulk: Term) -> list[SkinPart]:
        """Return the parts of the skin, pulled at and stiffened by `bulk`."""
        own, solver = self.tissues, self._solver
        msh = own.u.function_space.mesh
        # Height of the cell over its facet; point by point where the mesh is curved.
        height = abs(ufl.JacobianDeterminant(msh)) / FacetJacobianDeterminant(msh)
        metadata = {"quadrature_degree": solver.contact_degree}
        ds = ufl.Measure("ds", msh, subdomain_data=self.facets, metadata=metadata)
        parts = []
        for tissue, tag in own.domain.tissues_of(self.facets).items():
            stiffness = bulk.skin_stiffness(tissue, self._gamma, height)
            law = ContactLaw(
                self.obstacle,
                own.on_surface(bulk.stress(tissue)),
                own.u,
                own.state.u_old,
                self.friction,
                self._local,
                own.area_stretch(),
                stiffness,
                self._width,
                self._softness,
                self._untransmitted,
                solver.nitsche_theta,
            )
            reach = ZERO_BELOW * self._width / stiffness + _PULL_OUT_SHARE * height
            if solver.nitsche_theta:  # the form has terms where nothing touches as well
                reach = Constant(msh, _UNLIMITED_MM)
            parts.append(SkinPart(law, ds(tag), reach))
        return parts

    def at_points(self, of: Callable[[SkinPart], Expr]) -> PointValues:
        """Return what evaluates a value of each part at the contact quadrature points."""
        return PointValues(self.obstacle, [(of(part), part.ds) for part in self.parts])

    def residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work of the contact tractions in `v`."""
        return sum((part.law.residual(v) * part.ds for part in self.parts), ufl.Form([]))

    @contextmanager
    def regularized(self, width: float, softness: float) -> Iterator[None]:
        """Have contact set in over `width` times the pressure, and softer friction."""
        own_width = float(self._width.value)
        self._width.value, self._softness.value = width * own_width, softness
        try:
            yield
        finally:
            self._width.value, self._softness.value = own_width, 0.0


class _Stick(PointHistory):
    """Tangential traction that the contact did not transmit in the last accepted step, MPa."""

    def __init__(self, old: fem.Function, obstacle: Obstacle, values: PointValues) -> None:
        super().__init__("unmatched_MPa", old, obstacle.comm)
        self._obstacle, self._values = obstacle, values

    def points_mm(self) -> np.ndarray:
        """Return the undeformed contact quadrature points of this rank, (points, dimension)."""
        return self._obstacle.points_mm

    def present(self) -> np.ndarray:
        """Return the traction that the contact does not transmit at the present state."""
        return self._values.read()
