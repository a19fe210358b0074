"""Deformation and constitutive laws of the layered tissue, in UFL: what all terms share."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType

import ufl
from ufl.core.expr import Expr

from tactile_fem.assembly.compile import Constant
from tactile_fem.mechanics.domain import Domain
from tactile_fem.mechanics.state import State
from tactile_fem.tissue.constants import Tissue
from tactile_fem.tissue.energies import At, Fields, Law, bulk_modulus, shear_modulus

NO_LAWS: Mapping[str, Law] = MappingProxyType({})
# Xiao and Gimbutas' rules need 11 points in a tetrahedron for the default degree where Basix's own
# has 14. Still fewer would slow Newton's method down.
_TANGENT_SCHEME = "Xiao-Gimbutas"


def deformation_gradient(u: Expr) -> Expr:
    """Return ``F = I + grad u``, (3, 3); a section is in plane strain."""
    return ufl.Identity(3) + _embedded(ufl.grad(u))


def _embedded(A: Expr) -> Expr:
    """Return a tensor of the mesh's dimension as one of three, zero out of the plane."""
    if A.ufl_shape == (3, 3):
        return A
    return ufl.as_tensor([[A[0, 0], A[0, 1], 0], [A[1, 0], A[1, 1], 0], [0, 0, 0]])


class Tissues:
    """The tissues at a state.

    Parameters
    ----------
    domain
        The finger and where its tissues are.
    constants
        Constants of the tissues.
    state
        Displacement (mm) now and at the last accepted step.
    degree
        Quadrature degree.
    laws
        Own laws by the name of the tissue, in place of those of its constants.

    Attributes
    ----------
    F, F_old
        Deformation gradient now and at the last accepted step, (3, 3).
    at
        Undeformed position (mm) and the finger's fields, for laws.
    materials
        Materials of the study by the name of the tissue; each number is a `Constant` of the forms.
    laws
        Elastic laws by the name of the tissue: own ones or `materials`.
    shear_moduli, bulk_moduli
        Moduli at small strain, MPa, by the name of the tissue.
    dx, dx_of_tangent
        Volume measure of all tissues, for residuals and for tangents.
    """

    def __init__(
        self,
        domain: Domain,
        constants: Tissue,
        state: State,
        degree: int,
        laws: Mapping[str, Law] = NO_LAWS,
    ) -> None:
        self.domain, self.state, self.u = domain, state, state.u
        self.constants = constants
        msh = self.u.function_space.mesh
        self.tags = domain.tissues_of(domain.tissue)
        self.materials = {
            name: material.with_constants(partial(Constant, msh))
            for name, material in constants.materials().items()
        }
        self.laws: Mapping[str, Law] = {**self.materials, **laws}
        self.F = deformation_gradient(state.u)
        self.F_old = deformation_gradient(state.u_old)
        self.at = At(self._in_space(ufl.SpatialCoordinate(msh)), Fields(domain.fields))
        self.shear_moduli, self.bulk_moduli = (
            {name: modulus(self.laws[name], self.at) for name in self.tags}
            for modulus in (shear_modulus, bulk_modulus)
        )
        self._normal = self._in_space(ufl.FacetNormal(msh))
        self.dx = ufl.Measure(
            "dx", msh, subdomain_data=domain.tissue, metadata={"quadrature_degree": degree}
        )
        self.dx_of_tangent = self.dx(degree=degree, scheme=_TANGENT_SCHEME)

    @property
    def X(self) -> Expr:
        """Undeformed position, (3,) mm, as own terms take it."""
        return self.at.X

    def parts(self, dx: ufl.Measure) -> dict[str, ufl.Measure]:
        """Return the part in each tissue of a volume measure."""
        return {name: dx(tag) for name, tag in self.tags.items()}

    def gradient(self, v: Expr) -> Expr:
        """Return the gradient of a vector field, (3, 3)."""
        return _embedded(ufl.grad(v))

    def on_surface(self, P: Expr) -> Expr:
        """Return a first Piola stress times the normal of the undeformed surface, in MPa."""
        t = P * self._normal
        return ufl.as_vector([t[i] for i in range(len(self.u))])

    def area_stretch(self) -> Expr:
        """Return deformed over undeformed area of the surface (Nanson's formula)."""
        across = ufl.inv(self.F).T * self._normal
        return ufl.det(self.F) * ufl.sqrt(ufl.dot(across, across))

    def _in_space(self, vector: Expr) -> Expr:
        return vector if len(vector) == 3 else ufl.as_vector([vector[0], vector[1], 0])
