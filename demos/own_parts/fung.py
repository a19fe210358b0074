"""A tissue law: fat that stiffens exponentially (Fung 1967)."""

from dataclasses import dataclass

import ufl


@dataclass(frozen=True)
class Fung:
    """W = shear (exp(b (I1bar - 3)) - 1) / (2 b) + bulk (J - 1)^2 / 2, in MPa."""

    shear: float
    bulk: float
    b: float

    def energy(self, F, X):
        """Return the energy of the deformation gradient F at the undeformed position X."""
        J = ufl.det(F)
        distortion = J ** (-2 / 3) * ufl.tr(F.T * F) - 3
        return self.in_shear(distortion, X) + self.bulk / 2 * (J - 1) ** 2

    def in_shear(self, a, X):
        """Return the energy of the simple shear gamma^2 = a, for a tissue that relaxes."""
        return self.shear / (2 * self.b) * (ufl.exp(self.b * a) - 1)
