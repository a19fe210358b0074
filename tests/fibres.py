"""A law with a field, in one file: fibres in a neo-Hookean tissue, as a script may add it."""

from __future__ import annotations

from typing import Literal

import ufl
from pydantic import Field

from tactile_fem.runtime.settings import NonNegative, Positive
from tactile_fem.study import Material


class Fibred(Material):
    """Neo-Hookean tissue with fibres of one direction, which carry tension only.

    ``W = C10 (I1bar - 3) + k1/(2 k2) (exp(k2 <I4bar - 1>^2) - 1) + (J - 1)^2/D1`` with
    ``I4bar = J^(-2/3) |F a|^2`` and the directions `a`, unit vectors in the finger's field "fibre"
    (Holzapfel, Gasser and Ogden 2000, DOI 10.1023/A:1010835316564).
    """

    law: Literal["fibred"] = "fibred"
    C10_MPa: Positive = Field(description="of (I1bar - 3)")
    k1_MPa: NonNegative = Field(description="stiffness of the fibres at small strain")
    k2: Positive = Field(1.0, description="how fast they stiffen")
    D1_per_MPa: Positive = Field(description="2/K, of (J - 1)^2 / D1")

    def energy(self, F, at):
        """Return the strain energy density, in MPa."""
        J, along = ufl.det(F), F * at.fields["fibre"]
        stretched = ufl.max_value(J ** (-2 / 3) * ufl.dot(along, along) - 1, 0.0)
        of_fibres = self.k1_MPa / (2 * self.k2) * (ufl.exp(self.k2 * stretched**2) - 1)
        return (
            self.C10_MPa * (J ** (-2 / 3) * ufl.tr(F.T * F) - 3)
            + of_fibres
            + (J - 1) ** 2 / self.D1_per_MPa
        )


# Other tests see the package's laws only.
del Material.kinds["fibred"]
