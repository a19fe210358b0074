"""Tissue that relaxes: transient networks beside the elastic one, in UFL.

Beside the elastic law, which carries load for ever, stand networks whose chains break and form
anew (Green and Tobolsky 1946, DOI 10.1063/1.1724109). Chains break at the rate ``1/tau`` and form
without stress in the present shape, so the mean of the inverse metrics in which they formed follows

    dA/dt = (Cbar^-1 - A) / tau,        A = I at rest,        Cbar = J^(-2/3) F^T F,

linear with constant rates. A network is distorted by

    a = tr(Cbar A) - ln det A - 3,

which is ``I1bar - 3`` as long as no chain has broken and 0 when all have. It stores `beta` times
what the law stores in the simple shear of that distortion, ``a = gamma^2``. At once the tissue is
``1 + sum beta`` times as stiff in shear as in the long run, at any strain, and at small strain it
is the generalized Maxwell model with the Prony series ``g_k = beta_k / (1 + sum beta)``. What a
network loses is never negative, since ``tr X + tr X^-1 >= 6``. A change of volume does not relax.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import ufl
from ufl.core.expr import Expr

from tactile_fem.tissue.energies import At


@dataclass(frozen=True)
class Prony:
    """A Prony series.

    Attributes
    ----------
    g
        Shares of the instantaneous shear stiffness that relax; their sum is below 1.
    tau_s
        Times over which they do.
    """

    g: tuple[float, ...]
    tau_s: tuple[float, ...]

    @property
    def ratios(self) -> list[float]:
        """Stiffness of each network over that of the elastic one, `beta`."""
        lasting = 1 - sum(self.g)
        return [share / lasting for share in self.g]

    def weights(self, dt_s: float) -> list[tuple[float, float, float]]:
        """Return what `A` takes of itself, of the old and of the new ``Cbar^-1`` in a step.

        They solve the evolution exactly if ``Cbar^-1`` changes linearly in the step. They are not
        negative and their sum is 1, so `A` stays positive definite over any step.
        """
        found = []
        for tau_s in self.tau_s:
            x = dt_s / tau_s
            kept = math.exp(-x)
            mean = -math.expm1(-x) / x
            found.append((kept, mean - kept, 1 - mean))
        return found


class ShearLaw(Protocol):
    """A law whose energy in simple shear is known, as networks need it."""

    def in_shear(self, a: Expr, at: At) -> Expr:
        """Return the energy in the simple shear ``gamma^2 = a`` at a place, in MPa."""


@dataclass(frozen=True)
class Network:
    """One transient network over a step.

    Parameters
    ----------
    law
        The elastic law.
    ratio
        Stiffness over that of the law, `beta`.
    at
        The place.
    carried, new
        `A` is their sum: ``carried``, (3, 3), which the step began with, and ``new`` times the
        present ``Cbar^-1``.
    """

    law: ShearLaw
    ratio: Expr | float
    at: At
    carried: Expr
    new: Expr | float

    def energy(self, F: Expr) -> Expr:
        """Return what it stores at `F`, in MPa."""
        return self.ratio * self.law.in_shear(self._distortion(F), self.at)

    def stress(self, F: Expr) -> Expr:
        """Return its first Piola stress ``dW/dF`` while no chain breaks, in MPa.

        The chains that form in the step are without stress: only the carried ones pull.
        """
        a = ufl.variable(self._distortion(F))
        variable = ufl.variable(F)
        pull = ufl.diff(self._carried_invariant(variable), variable)
        return self.ratio * ufl.diff(self.law.in_shear(a, self.at), a) * pull

    def _carried_invariant(self, F: Expr) -> Expr:
        """Return the trace of ``Cbar`` times what is carried."""
        return ufl.det(F) ** (-2 / 3) * ufl.inner(F * self.carried, F)

    def _distortion(self, F: Expr) -> Expr:
        """Return `a`, with the determinant of `A` by the invariants of ``Cbar carried``."""
        m, w = self._carried_invariant(F), self.new
        X = F.T * F * self.carried
        second = (m**2 - ufl.det(F) ** (-4 / 3) * ufl.tr(X * X)) / 2
        determinant = w**3 + w**2 * m + w * second + ufl.det(self.carried)
        return m + 3 * w - 3 - ufl.ln(determinant)


def inverse_metric(F: Expr) -> Expr:
    """Return ``Cbar^-1 = J^(2/3) (F^T F)^-1``.

    It is kept at the nodes of cells, where J may be negative though it is positive wherever stress
    is needed; it is positive definite there, too.
    """
    inverse = ufl.inv(F)
    return (ufl.det(F) ** 2) ** (1 / 3) * inverse * inverse.T
