"""A law of a tissue that is a user's own code."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import ConfigDict

from tactile_fem.runtime.own_code import Code
from tactile_fem.runtime.settings import Finite
from tactile_fem.tissue.constants import Material

if TYPE_CHECKING:
    from ufl.core.expr import Expr

    from tactile_fem.tissue.energies import At

_KEY = "tissue: law = "


class OwnLaw(Material):
    """A user's own law: ``energy(F, at, **constants)``, or a class of `tactile_fem.Law`.

    Its constants, which the class takes, are further keys.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Finite]
    law: Code

    def energy(self, F: Expr, at: At) -> Expr:
        """Return the strain energy density, in MPa."""
        own = self._made()
        with self.law.running(_KEY):
            is_law = hasattr(own, "energy")
            return own.energy(F, at) if is_law else own(F, at, **self.__pydantic_extra__)

    @property
    def in_shear(self) -> Any:
        """The method of the class; AttributeError if it has none."""
        return self._made().in_shear

    def _made(self) -> Any:
        """Return the function, or the object with the constants, which those of forms replace."""
        code, constants = self.law.load(_KEY), self.__pydantic_extra__
        if not isinstance(code, type):
            return code
        with self.law.running(_KEY):
            own = code(**{name: float(value) for name, value in constants.items()})
        for name, value in constants.items():
            object.__setattr__(own, name, value)
        return own


Material.coded = OwnLaw
