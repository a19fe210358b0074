"""The elastic laws of the tissues: ``Int P(F) : grad v dX`` with ``P = dW/dF``.

Quadratic tetrahedra that resist a change of volume at every quadrature point lock. The share of
this resistance beyond a ratio K/G, the locking ratio, is therefore integrated at the elements'
centres, so that each element resists a change of its own volume. Laws whose moduli vary in space
are integrated at all points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import ufl
from ufl.checks import is_scalar_constant_expression
from ufl.core.expr import Expr

from tactile_fem.mechanics.terms.term import StressTerm
from tactile_fem.mechanics.tissues import Tissues
from tactile_fem.study import Solver
from tactile_fem.tissue.energies import Law, VolumeChange, stiffness, stress

# Least share of the volumetric stiffness at all points: elements without shear need a little.
_LEAST_SHARE = 0.02


class Hyperelasticity(StressTerm):
    """The elastic laws; `locking_ratio` is K/G as above."""

    is_symmetric = True

    def __init__(self, tissues: Tissues, locking_ratio: float) -> None:
        super().__init__(tissues)
        self._locking_ratio = locking_ratio

    @classmethod
    def of(cls, tissues: Tissues, solver: Solver) -> list[Hyperelasticity]:
        """Return the term; every finger has it."""
        return [cls(tissues, solver.locking_ratio)]

    def stress(self, tissue: str) -> Expr:
        """Return ``dW/dF``, MPa."""
        return stress(self.tissues.laws[tissue], self.tissues.F, self.tissues.at)

    def energy(self, tissue: str) -> Expr:
        """Return ``W``, MPa."""
        return self.tissues.laws[tissue].energy(self.tissues.F, self.tissues.at)

    def stored(self, w: Expr) -> ufl.Form:
        """Return the strain energy, weighted with `w`."""
        own, parts = self.tissues, self.tissues.parts(self.tissues.dx)
        return super().stored(w) + self._moved_to_centres(
            lambda law: law.energy(own.F, own.at) * w, parts
        )

    def skin_stiffness(self, tissue: str, gamma: Expr, height: Expr) -> Expr:
        """Return ``gamma (K + 4 G/3)/h`` at the last accepted state, MPa/mm."""
        own = self.tissues
        return gamma * stiffness(own.laws[tissue], own.F_old, own.at) / height

    def _work(self, v: Expr, dx: ufl.Measure) -> ufl.Form:
        own, gradient = self.tissues, self.tissues.gradient(v)
        moved = self._moved_to_centres(
            lambda law: ufl.inner(stress(law, own.F, own.at), gradient), own.parts(dx)
        )
        return super()._work(v, dx) + moved

    def _moved_to_centres(
        self, integrand: Callable[[Law], Expr], parts: Mapping[str, ufl.Measure]
    ) -> ufl.Form:
        """Return what changes in an integral if volume change beyond the ratio is at centres."""
        form = ufl.Form([])
        for name, dx in parts.items():
            K, G = self.tissues.bulk_moduli[name], self.tissues.shear_moduli[name]
            if not all(map(is_scalar_constant_expression, (K, G))):
                continue
            if float(K) > self._locking_ratio * float(G):
                share: Expr | float = self._locking_ratio / (K / G)
                if self._locking_ratio < _LEAST_SHARE * float(K / G):
                    share = _LEAST_SHARE
                moved = (1 - share) * integrand(VolumeChange(self.tissues.laws[name]))
                form += moved * dx(degree=1) - moved * dx
        return form
