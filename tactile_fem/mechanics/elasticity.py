"""Stress and strain energy of the layered tissue at a displacement, in UFL."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType, SimpleNamespace

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from tactile_fem.finger import TISSUES
from tactile_fem.mechanics.domain import Domain
from tactile_fem.mechanics.relaxation import Relaxation
from tactile_fem.tissue.constants import Elastic, Polynomial, Tissue
from tactile_fem.tissue.energies import (
    Law,
    VolumeChange,
    bulk_over_shear,
    law_of,
    shear_modulus,
    stiffness,
    stress,
    tangent_shear_modulus,
)
from tactile_fem.tissue.relaxation import Network, Prony

NO_LAWS: Mapping[str, Law] = MappingProxyType({})
# Share of the resistance to a change of volume that is integrated at all points at least.
_LEAST_KEPT = 0.02
_FEW_POINTS = "Xiao-Gimbutas"


def deformation_gradient(u: Expr) -> Expr:
    """Return ``F = I + grad u``, (3, 3); a section is in plane strain."""
    return ufl.Identity(3) + _embedded(ufl.grad(u))


def _embedded(A: Expr) -> Expr:
    """Return a tensor of the mesh's dimension as one of three, zero out of the plane."""
    if A.ufl_shape == (3, 3):
        return A
    return ufl.as_tensor([[A[0, 0], A[0, 1], 0], [A[1, 0], A[1, 1], 0], [0, 0, 0]])


class Elasticity:
    """The tissues between two states.

    Parameters
    ----------
    domain
        The finger and where its tissues are.
    tissue
        Constants of the tissues.
    u, u_old
        Displacement (mm) now and at the last accepted step.
    degree
        Of the quadrature.
    locking_ratio
        K/G up to which volume change is integrated with that degree. What is stiffer is integrated
        at the elements' centres: quadratic tetrahedra that resist a change of volume at every
        point lock. Own laws are integrated with that degree always.
    laws
        Own laws by the name of the tissue, in place of those of its constants.

    Attributes
    ----------
    values
        By the name of the tissue: the constants in the forms, a `fem.Constant` by each name.
    relaxation
        History of the tissues that relax; None if none does.
    """

    def __init__(
        self,
        domain: Domain,
        tissue: Tissue,
        u: fem.Function,
        u_old: fem.Function,
        degree: int,
        locking_ratio: float = math.inf,
        laws: Mapping[str, Law] = NO_LAWS,
    ) -> None:
        self.domain, self.u, self.u_old = domain, u, u_old
        self._mesh = u.function_space.mesh
        self._tissue, self._laws = tissue, laws
        self._degree, self._locking_ratio = degree, locking_ratio
        self.values = {name: self._in_forms(self.constants(name)) for name in TISSUES}
        self._F = deformation_gradient(u)
        self._F_old = deformation_gradient(u_old)
        series = {name: self._series(name) for name in domain.tissues_of(domain.tissue)}
        relaxing = {name: prony for name, prony in series.items() if prony.g}
        self.relaxation = Relaxation(domain, relaxing, self._F, self._F_old) if relaxing else None
        self._rate = fem.Constant(self._mesh, 0.0)  # viscous time over time step
        N = ufl.FacetNormal(self._mesh)
        self._normal = N if len(N) == 3 else ufl.as_vector([N[0], N[1], 0])

    @property
    def viscous_time_s(self) -> float:
        """Kelvin and Voigt's time."""
        return self._tissue.viscous_time_s

    def set_time_step(self, dt_s: float) -> None:
        """Set the time between the two states."""
        self._rate.value = self._tissue.viscous_time_s / dt_s
        if self.relaxation:
            self.relaxation.set_time_step(dt_s)

    def linearize(
        self, dt_old_s: float, share: Callable[[float], float], viscous: float = 0.0
    ) -> None:
        """Freeze coefficients at the accepted state (undone by `set_time_step`).

        Parameters
        ----------
        dt_old_s, share
            See `Relaxation.linearize`.
        viscous
            Kelvin-Voigt's stress as a multiple of that which a strain of its own size causes.
        """
        self._rate.value = viscous
        if self.relaxation:
            self.relaxation.linearize(dt_old_s, share)

    def constants(self, tissue: str) -> Polynomial | Elastic:
        """Return the constants of a tissue."""
        return getattr(self._tissue, tissue)

    def energy(self, tissue: str) -> Expr:
        """Return the strain energy density that a tissue stores, in MPa."""
        W = self._law(tissue).energy(self._F)
        return sum((network.energy(self._F) for network in self._networks(tissue)), W)

    def stored_stress(self, tissue: str) -> Expr:
        """Return the first Piola stress of what a tissue stores, in MPa.

        That of the elastic law and of the networks that relax, without Kelvin-Voigt's viscosity.
        """
        P = stress(self._law(tissue), self._F)
        return sum((network.stress(self._F) for network in self._networks(tissue)), P)

    def traction(self, tissue: str) -> Expr:
        """Return that stress times the normal of the undeformed surface, in MPa."""
        return self._on_surface(self.stored_stress(tissue))

    def whole_traction(self, tissue: str) -> Expr:
        """Return what `stress` pulls at the surface, the viscous part included, in MPa."""
        return self._on_surface(self.stress(tissue))

    def _on_surface(self, P: Expr) -> Expr:
        t = P * self._normal
        return ufl.as_vector([t[i] for i in range(len(self.u))])

    def area_stretch(self) -> Expr:
        """Return deformed over undeformed area of the surface (Nanson's formula)."""
        across = ufl.inv(self._F).T * self._normal
        return ufl.det(self._F) * ufl.sqrt(ufl.dot(across, across))

    def stress(self, tissue: str, u_old: fem.Function | None = None) -> Expr:
        """Return the first Piola stress of a tissue, stored and viscous, in MPa.

        The viscous part is Kelvin-Voigt's: ``S = 2 G tau (E - E_old)/dt`` with the tissue's
        small-strain shear modulus `G`.

        Parameters
        ----------
        tissue
            Its name.
        u_old
            Displacement a time step ago, if not that of the last accepted step.
        """
        F, F_old = self._F, self._F_old if u_old is None else deformation_gradient(u_old)
        P = self.stored_stress(tissue)
        if self._tissue.viscous_time_s:
            G = self._shear_modulus(tissue)
            P += F * (G * self._rate * (F.T * F - F_old.T * F_old))
        return P

    def stiffness(self, tissue: str) -> Expr:
        """Return how stiff a tissue is at the last accepted state, ``K + 4 G/3``, in MPa.

        `G` is that over the present step, if it relaxes.
        """
        stiffening = self.relaxation.stiffening(tissue) if self.relaxation else 0.0
        return stiffness(self._law(tissue), self._F_old, 1 + stiffening)

    def viscous_stiffness(self, tissue: str) -> Expr:
        """Return how stiff the viscous stress makes a tissue over the present step, in MPa."""
        return 2 * self._shear_modulus(tissue) * self._rate

    def residual(self, v: Expr, dx: ufl.Measure | None = None) -> ufl.Form:
        """Return the virtual work of the stresses in `v`, integrated by `measure` or by `dx`."""
        gradient = _embedded(ufl.grad(v))
        measures = self._measures(dx)
        form = sum(ufl.inner(self.stress(name), gradient) * dx for name, dx in measures.items())
        unlocked = self._unlocked(lambda law: ufl.inner(stress(law, self._F), gradient), measures)
        return form + unlocked

    def tangent(self, v: Expr) -> ufl.Form:
        """Return the derivative of `residual`, integrated at fewer points.

        Xiao and Gimbutas' rules need 11 points in a tetrahedron for the default degree where
        Basix's own, that of the residual, has 14. Still fewer would slow Newton's method down.
        """
        dx = self.measure()(degree=self._degree, scheme=_FEW_POINTS)
        return ufl.derivative(self.residual(v, dx), self.u)

    def stored(self, w: Expr) -> ufl.Form:
        """Return the strain energy of all tissues, weighted with `w`."""
        measures = self._measures()
        form = sum(self.energy(name) * w * dx for name, dx in measures.items())
        return form + self._unlocked(lambda law: law.energy(self._F) * w, measures)

    def _unlocked(self, of: Callable[[Law], Expr], measures: Mapping[str, ufl.Measure]) -> ufl.Form:
        """Return what changes in the integral `of` the laws if no tissue locks.

        The share of the resistance to a change of volume that goes beyond the locking ratio moves
        from all points to the elements' centres, so each element resists that of its own volume.
        """
        form = ufl.Form([])
        for name, dx in measures.items():
            constants, values = self.constants(name), self.values[name]
            if name not in self._laws and bulk_over_shear(constants) > self._locking_ratio:
                moved = (1 - self._kept(constants, values)) * of(VolumeChange(self._law(name)))
                form += moved * dx(degree=1) - moved * dx
        return form

    def _kept(self, constants: Polynomial | Elastic, values: SimpleNamespace) -> Expr | float:
        """Return the share that stays at all points: elements without shear need a little."""
        if self._locking_ratio < _LEAST_KEPT * bulk_over_shear(constants):
            return _LEAST_KEPT
        return self._locking_ratio / bulk_over_shear(constants, values)

    def measure(self) -> ufl.Measure:
        """Return the volume measure of all tissues."""
        metadata = {"quadrature_degree": self._degree}
        return ufl.Measure("dx", self._mesh, subdomain_data=self.domain.tissue, metadata=metadata)

    def _measures(self, dx: ufl.Measure | None = None) -> dict[str, ufl.Measure]:
        """Return the part in each tissue of a volume measure, by default of `measure`."""
        dx = dx or self.measure()
        return {name: dx(tag) for name, tag in self.domain.tissues_of(self.domain.tissue).items()}

    def _series(self, tissue: str) -> Prony:
        constants = self.constants(tissue)
        return Prony(constants.g, constants.tau_s)

    def _networks(self, tissue: str) -> list[Network]:
        law = self._law(tissue)
        return self.relaxation.networks(tissue, law) if self.relaxation else []

    def _law(self, tissue: str) -> Law:
        return self._laws.get(tissue) or law_of(self.constants(tissue), self.values[tissue])

    def _shear_modulus(self, tissue: str) -> Expr:
        if tissue in self._laws:
            at_rest = fem.Constant(self._mesh, 0.0)
            return tangent_shear_modulus(self._laws[tissue], at_rest)
        return shear_modulus(self.constants(tissue), self.values[tissue])

    def _in_forms(self, constants: Polynomial | Elastic) -> SimpleNamespace:
        given = {name: value for name, value in constants if isinstance(value, float)}
        return SimpleNamespace(
            **{name: fem.Constant(self._mesh, value) for name, value in given.items()}
        )
