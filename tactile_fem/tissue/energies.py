"""Strain energies of the tissues, in UFL.

A law is a small frozen dataclass that defines only its energy `W(F, X)` in MPa (mJ/mm3), where `X`
is the undeformed position: constants and directions of fibres may vary in space. `stress` derives
the first Piola stress, and the tangent is UFL's derivative of the residual.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from typing import Any, Protocol

import ufl
from ufl.core.expr import Expr

from tactile_fem.tissue.constants import Elastic, Polynomial


class Law(Protocol):
    """A hyperelastic law, defined by its energy."""

    def energy(self, F: Expr, X: Expr) -> Expr:
        """Return the strain energy density, in MPa.

        Parameters
        ----------
        F
            Deformation gradient, (3, 3).
        X
            Undeformed position in the finger's axes, mm, (3,).
        """


@dataclass(frozen=True)
class PolynomialEnergy:
    """Second-order polynomial energy (paper; in the form of Abaqus) with Yeoh's cubic term.

    ``W = sum_{1<=i+j<=2} C_ij (I1bar-3)^i (I2bar-3)^j + C_30 (I1bar-3)^3 + sum_i (J-1)^(2i)/D_i``
    with the invariants of ``Cbar = J^(-2/3) C``. With C10 alone it is neo-Hookean.

    Parameters
    ----------
    constants
        Which terms there are.
    values
        What stands for the constants in the energy, by the same names: UFL constants, whose change
        does not recompile the forms. Default: their numbers.
    """

    constants: Polynomial
    values: Any = None

    def energy(self, F: Expr, X: Expr) -> Expr:
        """Return the strain energy density of `F`, in MPa; the same everywhere."""
        terms, (J, a, b) = self.constants, _invariants(F)
        c = self.values or terms
        W = self._of_shape(a, b)
        W += (J - 1) ** 2 / c.D1_per_MPa
        if terms.D2_per_MPa is not None:
            W += (J - 1) ** 4 / c.D2_per_MPa
        return W

    def in_shear(self, a: Expr, X: Expr) -> Expr:
        """Return the energy in the simple shear ``gamma^2 = a``, where both invariants are `a`."""
        return self._of_shape(a, a)

    def _of_shape(self, a: Expr, b: Expr) -> Expr:
        """Return the energy without that of a change of volume."""
        terms = self.constants
        c = self.values or terms
        W = c.C10_MPa * a
        if terms.C20_MPa:
            W += c.C20_MPa * a**2
        if terms.C30_MPa:
            W += c.C30_MPa * a**3
        if terms.C01_MPa or terms.C11_MPa or terms.C02_MPa:
            W += c.C01_MPa * b + c.C11_MPa * a * b + c.C02_MPa * b**2
        return W


@dataclass(frozen=True)
class StVenantKirchhoff:
    """Linear elasticity in the Green-Lagrange strain, for bone and nail (paper: linear elastic).

    Unlike small-strain elasticity it is indifferent to rotation; the two agree at the strains
    that bone and nail reach.
    """

    constants: Elastic
    values: Any = None

    def energy(self, F: Expr, X: Expr) -> Expr:
        """Return the strain energy density of `F`, in MPa; the same everywhere."""
        c = self.values or self.constants
        lame = c.E_MPa * c.nu / ((1 + c.nu) * (1 - 2 * c.nu))
        shear = shear_modulus(self.constants, c)
        E = (F.T * F - ufl.Identity(3)) / 2
        return lame / 2 * ufl.tr(E) ** 2 + shear * ufl.inner(E, E)

    def in_shear(self, a: Expr, X: Expr) -> Expr:
        """Return the energy in the simple shear ``gamma^2 = a`` as far as it is linear in `a`."""
        return shear_modulus(self.constants, self.values or self.constants) / 2 * a


@dataclass(frozen=True)
class VolumeChange:
    """The part of a law's energy that a change of volume alone would store."""

    law: Law

    def energy(self, F: Expr, X: Expr) -> Expr:
        """Return ``W(J^(1/3) I)``, in MPa."""
        return self.law.energy(ufl.det(F) ** (1 / 3) * ufl.Identity(3), X)


def _invariants(F: Expr) -> tuple[Expr, Expr, Expr]:
    """Return ``J``, ``I1bar - 3`` and ``I2bar - 3``."""
    J, C = ufl.det(F), F.T * F
    I1 = ufl.tr(C)
    I2 = (I1**2 - ufl.tr(C * C)) / 2
    return J, J ** (-2 / 3) * I1 - 3, J ** (-4 / 3) * I2 - 3


def stress(law: Law, F: Expr, X: Expr) -> Expr:
    """Return the first Piola stress ``dW/dF`` of `law` at the position `X`, in MPa."""
    variable = ufl.variable(F)
    return ufl.diff(law.energy(variable, X), variable)


def stiffness(law: Law, F: Expr, X: Expr) -> Expr:
    """Return the stiffness ``K + 4 G/3`` of `law` at `F` and the position `X`, in MPa.

    `K` is the slope of the pressure in a pure volume change to the volume of `F`, `G` that of
    `shear_stiffness`.
    """
    J = ufl.variable(ufl.det(F))
    K = ufl.diff(ufl.diff(law.energy(J ** (1 / 3) * ufl.Identity(3), X), J), J)
    return K + 4 * shear_stiffness(law, F, X) / 3


def shear_stiffness(law: Law, F: Expr, X: Expr) -> Expr:
    """Return the slope of the shear stress at the distortion of `F`, ``gamma^2 = I1bar - 3``."""
    distortion = _invariants(F)[1]
    return tangent_shear_modulus(law, ufl.sqrt(ufl.max_value(distortion, 0.0)), X)


def tangent_shear_modulus(law: Law, shear: Expr, X: Expr) -> Expr:
    """Return the slope of the shear stress in simple `shear`, in MPa."""
    gamma = ufl.variable(shear)
    across = ufl.as_matrix([[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    return ufl.diff(ufl.diff(law.energy(ufl.Identity(3) + gamma * across, X), gamma), gamma)


def shear_modulus(constants: Polynomial | Elastic, values: Any = None) -> Any:
    """Return the small-strain shear modulus, in MPa; `values` as in `PolynomialEnergy`."""
    c: Any = values or constants
    if isinstance(constants, Elastic):
        return c.E_MPa / (2 * (1 + c.nu))
    return 2 * (c.C10_MPa + c.C01_MPa)


def bulk_modulus(constants: Polynomial | Elastic, values: Any = None) -> Any:
    """Return the small-strain bulk modulus, in MPa; `values` as in `PolynomialEnergy`."""
    c: Any = values or constants
    if isinstance(constants, Elastic):
        return c.E_MPa / (3 * (1 - 2 * c.nu))
    return 2 / c.D1_per_MPa


def bulk_over_shear(constants: Polynomial | Elastic, values: Any = None) -> Any:
    """Return the small-strain ratio ``K/G``; `values` as in `PolynomialEnergy`."""
    return bulk_modulus(constants, values) / shear_modulus(constants, values)


def compression_modulus(constants: Polynomial | Elastic) -> float:
    """Return the small-strain uniaxial-strain modulus ``K + 4 G/3``, in MPa."""
    return bulk_modulus(constants) + 4 * shear_modulus(constants) / 3


@singledispatch
def law_of(constants: Any, values: Any = None) -> Law:
    """Return the law for a tissue's constants; ``law_of.register`` adds one."""
    raise TypeError(f"no law goes with {type(constants).__name__}")


law_of.register(Polynomial, PolynomialEnergy)
law_of.register(Elastic, StVenantKirchhoff)
