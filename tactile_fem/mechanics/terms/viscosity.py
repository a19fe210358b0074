"""Kelvin and Voigt's viscosity: ``S = 2 G tau (E - E_old)/dt`` with the tissue's shear modulus."""

from __future__ import annotations

from ufl.core.expr import Expr

from tactile_fem.assembly.compile import Constant
from tactile_fem.mechanics.terms.term import Delay, StressTerm
from tactile_fem.mechanics.tissues import Tissues
from tactile_fem.study import Solver


class Viscosity(StressTerm):
    """A stress that follows the rate of strain.

    It does not pull at the skin: over the short time of a cut step it would be too stiff for
    gamma_h. The gap is off by what it carries over gamma_h, some 1e-5 mm.

    Parameters
    ----------
    tissues
        Their strain and shear moduli.
    time_s
        `tau`.
    """

    is_symmetric = True
    pulls_at_skin = False

    def __init__(self, tissues: Tissues, time_s: float) -> None:
        super().__init__(tissues)
        self._time_s = time_s
        self._tau = Constant(tissues.u.function_space.mesh, time_s)
        self._rate = self._tau / tissues.state.time_step
        self.delays = [Delay(lambda w: 1j * w * time_s)]

    @classmethod
    def of(cls, tissues: Tissues, solver: Solver) -> list[Viscosity]:
        """Return the term, if the tissues are viscous."""
        time_s = tissues.constants.viscous_time_s
        return [cls(tissues, time_s)] if time_s else []

    def stress(self, tissue: str) -> Expr:
        """Return ``F S``, MPa."""
        own, G = self.tissues, self.tissues.shear_moduli[tissue]
        return own.F * (G * self._rate * (own.F.T * own.F - own.F_old.T * own.F_old))

    def skin_stiffness(self, tissue: str, gamma: Expr, height: Expr) -> Expr:
        """Return ``gamma 2 G tau/dt/h``, MPa/mm."""
        return gamma * 2 * self.tissues.shear_moduli[tissue] * self._rate / height

    def begin_step(self) -> None:
        """Take the state's time step over."""
        self._tau.value = self._time_s

    def freeze(self, delay: Delay | None) -> None:
        """Resist a change of strain by 2 G times its size, or not at all."""
        self._tau.value = self.tissues.state.dt_s if delay in self.delays else 0.0
