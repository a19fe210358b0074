"""The skin that may touch: one contact law for each tissue at the surface."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import ufl
from dolfinx import fem, mesh
from ufl.classes import FacetJacobianDeterminant

from tactile_fem.mechanics.contact import ZERO_BELOW, Contact, SkinPart
from tactile_fem.mechanics.elasticity import Elasticity
from tactile_fem.mechanics.inertia import Inertia
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.study import Solver

# Share of its outermost tetrahedron's height by which skin is pulled out at most. Traction that
# does this would be a third of the skin's modulus.
_PULLED = 0.25
_EVERYWHERE_MM = 1e6


@dataclass(frozen=True)
class Rounding:
    """How smoothly contact sets in, MPa, and how soft friction is; see `Contact`."""

    width: fem.Constant
    softness: fem.Constant

    @classmethod
    def of(cls, msh: mesh.Mesh, width_MPa: float) -> Rounding:
        """Return that of the law as it should be."""
        return cls(fem.Constant(msh, width_MPa), fem.Constant(msh, 0.0))

    @contextmanager
    def gentler(self, wider: float, softness: float) -> Iterator[None]:
        """Smooth contact over a width so many times as large, and friction, within the context."""
        own_width = float(self.width.value)
        self.width.value, self.softness.value = wider * own_width, softness
        try:
            yield
        finally:
            self.width.value, self.softness.value = own_width, 0.0


def parts_of_skin(
    facets: mesh.MeshTags,
    elasticity: Elasticity,
    obstacle: Obstacle,
    friction: float,
    rounding: Rounding,
    unmatched_old: fem.Function,
    solver: Solver,
    inertia: Inertia | None,
) -> list[SkinPart]:
    """Return the parts of the skin, one for each tissue.

    Parameters
    ----------
    facets
        Of the skin, by the tissue behind them.
    elasticity, obstacle
        The tissues and the rigid body.
    friction
        Coulomb's coefficient.
    rounding
        Of all parts.
    unmatched_old
        See `Contact`.
    solver
        Discretization of the contact.
    inertia
        Of the tissues, if they have any.
    """
    domain = elasticity.domain
    msh = domain.mesh
    # Of the tetrahedron over its facet; point by point where the mesh is curved.
    height = abs(ufl.JacobianDeterminant(msh)) / FacetJacobianDeterminant(msh)
    gamma = fem.Constant(msh, solver.nitsche_gamma)
    metadata = {"quadrature_degree": solver.contact_degree}
    ds = ufl.Measure("ds", msh, subdomain_data=facets, metadata=metadata)
    parts = []
    for tissue, tag in domain.tissues_of(facets).items():
        stiffness = gamma * elasticity.stiffness(tissue) / height
        if inertia:
            stiffness += inertia.stiffness(height)
        contact = Contact(
            obstacle,
            fem.Constant(msh, friction),
            stiffness,
            rounding.width,
            rounding.softness,
            unmatched_old,
            solver.nitsche_theta,
        )
        reach = ZERO_BELOW * rounding.width / stiffness + _PULLED * height
        if solver.nitsche_theta:  # the form has terms where nothing touches as well
            reach = fem.Constant(msh, _EVERYWHERE_MM)
        # Without Kelvin-Voigt's viscosity: over the short time of a cut step it would be too
        # stiff for gamma_h. The gap is off by what it carries over gamma_h, some 1e-5 mm.
        parts.append(SkinPart(tissue, contact, elasticity.traction(tissue), ds(tag), reach))
    return parts
