"""The elastic laws of the tissues: ``Int P(F) : grad v dX`` with ``P = dW/dF``.

Quadratic tetrahedra that resist a change of volume at every quadrature point lock. The share of
this resistance beyond a ratio K/G, the locking ratio, is therefore integrated at the elements'
centres, so that each element resists a change of its own volume. Own laws are integrated at all
points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import ufl
from ufl.core.expr import Expr

from tactile_fem.mechanics.terms.term import StressTerm
from tactile_fem.mechanics.tissues import Tissues
from tactile_fem.study import Solver
from tactile_fem.tissue.energies import Law, VolumeChange, bulk_over_shear, stiffness, stress

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
        return stress(self.tissues.law(tissue), self.tissues.F, self.tissues.X)

    def energy(self, tissue: str) -> Expr:
        """Return ``W``, MPa."""
        return self.tissues.law(tissue).energy(self.tissues.F, self.tissues.X)

    def stored(self, w: Expr) -> ufl.Form:
        """Return the strain energy, weighted with `w`."""
        F, X, parts = self.tissues.F, self.tissues.X, self.tissues.parts(self.tissues.dx)
        return super().stored(w) + self._moved_to_centres(lambda law: law.energy(F, X) * w, parts)

    def skin_stiffness(self, tissue: str, gamma: Expr, height: Expr) -> Expr:
        """Return ``gamma (K + 4 G/3)/h`` at the last accepted state, MPa/mm."""
        own = self.tissues
        return gamma * stiffness(own.law(tissue), own.F_old, own.X) / height

    def _work(self, v: Expr, dx: ufl.Measure) -> ufl.Form:
        own, gradient = self.tissues, self.tissues.gradient(v)
        moved = self._moved_to_centres(
            lambda law: ufl.inner(stress(law, own.F, own.X), gradient), own.parts(dx)
        )
        return super()._work(v, dx) + moved

    def _moved_to_centres(
        self, integrand: Callable[[Law], Expr], parts: Mapping[str, ufl.Measure]
    ) -> ufl.Form:
        """Return what changes in an integral if volume change beyond the ratio is at centres."""
        form = ufl.Form([])
        for name, dx in parts.items():
            if name in self.tissues.laws:
                continue
            constants, values = getattr(self.tissues.constants, name), self.tissues.values[name]
            if bulk_over_shear(constants) > self._locking_ratio:
                share: Expr | float = self._locking_ratio / bulk_over_shear(constants, values)
                if self._locking_ratio < _LEAST_SHARE * bulk_over_shear(constants):
                    share = _LEAST_SHARE
                moved = (1 - share) * integrand(VolumeChange(self.tissues.law(name)))
                form += moved * dx(degree=1) - moved * dx
        return form
