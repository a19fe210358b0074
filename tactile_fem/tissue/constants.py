"""Laws of the tissues with their constants, and named sets of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from tactile_fem.errors import StudyError
from tactile_fem.runtime.own_code import Code
from tactile_fem.runtime.settings import Finite, Kind, NonNegative, Positive, Settings, nonzero

if TYPE_CHECKING:
    from ufl.core.expr import Expr

    from tactile_fem.tissue.energies import At

_OWN = "tissue: law = "


class Material(Kind):
    """Base class of the laws of tissues.

    A law states its name `law`, its long-term constants and its `energy`. In forms, numbers other
    than 0 are constants of DOLFINx: other values use the same compiled code. A law that may relax
    also states ``in_shear(a, at)``, its energy in the simple shear ``gamma^2 = a``: from `energy`
    it would not follow at rest, where ``dW/da`` is 0/0.
    """

    tag = "law"
    g: tuple[Annotated[Finite, Field(gt=0, lt=1)], ...] = Field(
        (), description="shares of the instantaneous shear stiffness that relax; none: elastic"
    )
    tau_s: tuple[Positive, ...] = Field((), description="their relaxation times")

    def energy(self, F: Expr, at: At) -> Expr:
        """Return the strain energy density, as `tactile_fem.tissue.energies.Law`."""
        raise StudyError(f'tissue: law = "{self.law}" is known where its module is imported')

    def with_constants(self, constant: Callable[[float], Any]) -> Self:
        """Return the law for forms: each number but 0 is what `constant` makes of it."""
        numbers = {key: value for key, value in self if isinstance(value, float) and value}
        return self.model_copy(update={key: constant(x) for key, x in numbers.items()})

    if TYPE_CHECKING:

        @property
        def law(self) -> str:
            """Name of the law, as a study states it."""

    def moduli(self) -> dict[str, int]:
        """Return the names of the moduli, with 1, and of the inverse ones, with -1."""
        return {
            name: -1 if name.endswith("_per_MPa") else 1
            for name, value in self
            if name.endswith("_MPa") and value
        }

    def scaled(self, factor: float) -> Self:
        """Return the tissue with its stiffness multiplied by a factor; relaxation is unchanged.

        Raises StudyError if the factor is not a positive number.
        """
        if not 0 < factor < math.inf:
            raise StudyError(f"factor is {factor:g} but must be a number above 0.")
        changed = {
            name: getattr(self, name) * factor**power for name, power in self.moduli().items()
        }
        return type(self).model_validate({**self.model_dump(exclude_unset=True), **changed})

    @model_validator(mode="after")
    def _leaves_some(self) -> Self:
        if len(self.g) != len(self.tau_s):
            raise ValueError(
                f"g has {len(self.g)} shares but tau_s {len(self.tau_s)} times; "
                "each share needs its own time"
            )
        if sum(self.g) >= 1:
            raise ValueError(
                f"the sum of g is {sum(self.g):g} but must be below 1: what does not relax "
                "carries the load in the long run"
            )
        return self


class Polynomial(Material):
    """Polynomial energy of order two, with the cubic term of Yeoh; neo-Hookean with C10 alone.

    ``W = sum_{1<=i+j<=2} C_ij (I1bar-3)^i (I2bar-3)^j + C_30 (I1bar-3)^3 + sum_i (J-1)^(2i)/D_i``
    with the invariants of ``Cbar = J^(-2/3) C`` (paper; in the form of Abaqus).
    """

    law: Literal["polynomial"] = Field(
        "polynomial",
        description='or "elastic" (E_MPa, nu), "ogden" (mu_MPa, alpha, D1_per_MPa), or '
        '"module:name", a law in a Python file beside the study, its constants as further keys',
    )
    C10_MPa: Positive = Field(description="of (I1bar - 3)")
    C01_MPa: Finite = Field(0.0, description="of (I2bar - 3)")
    C20_MPa: Finite = Field(0.0, description="of (I1bar - 3)^2")
    C11_MPa: Finite = Field(0.0, description="of (I1bar - 3)(I2bar - 3)")
    C02_MPa: Finite = Field(0.0, description="of (I2bar - 3)^2")
    C30_MPa: Finite = Field(0.0, description="of (I1bar - 3)^3")
    D1_per_MPa: Positive = Field(description="2/K, of (J - 1)^2 / D1")
    D2_per_MPa: Positive | None = Field(None, description="of (J - 1)^4 / D2; default: none")

    def energy(self, F: Expr, at: At) -> Expr:
        """Return the strain energy density, in MPa; the same everywhere."""
        from tactile_fem.tissue.energies import invariants  # takes a while

        J, a, b = invariants(F)
        W = self._of_shape(a, b)
        W += (J - 1) ** 2 / self.D1_per_MPa
        if self.D2_per_MPa is not None:
            W += (J - 1) ** 4 / self.D2_per_MPa
        return W

    def in_shear(self, a: Expr, at: At) -> Expr:
        """Return the energy in the simple shear ``gamma^2 = a``, where both invariants are `a`."""
        return self._of_shape(a, a)

    def _of_shape(self, a: Expr, b: Expr) -> Expr:
        """Return the energy without that of a change of volume."""
        W = self.C10_MPa * a
        if self.C20_MPa:
            W += self.C20_MPa * a**2
        if self.C30_MPa:
            W += self.C30_MPa * a**3
        if self.C01_MPa or self.C11_MPa or self.C02_MPa:
            W += self.C01_MPa * b + self.C11_MPa * a * b + self.C02_MPa * b**2
        return W

    @model_validator(mode="after")
    def _resists_shear(self) -> Self:
        if self.C10_MPa + self.C01_MPa <= 0:
            raise ValueError(
                f"C10_MPa + C01_MPa is {self.C10_MPa + self.C01_MPa:g} but must be greater than 0, "
                "being half the shear modulus"
            )
        return self


class Elastic(Material):
    """Linear elasticity in the Green-Lagrange strain (St. Venant-Kirchhoff), for bone and nail.

    Unlike small-strain elasticity (paper) it is objective; the two agree at the strains that bone
    and nail reach.
    """

    law: Literal["elastic"] = "elastic"
    E_MPa: Positive = Field(description="Young's modulus")
    nu: Annotated[Finite, Field(gt=-1.0, lt=0.5)] = Field(description="Poisson's ratio")

    def energy(self, F: Expr, at: At) -> Expr:
        """Return the strain energy density, in MPa; the same everywhere."""
        from ufl import Identity, inner, tr  # takes a while

        lame = self.E_MPa * self.nu / ((1 + self.nu) * (1 - 2 * self.nu))
        E = (F.T * F - Identity(3)) / 2
        return lame / 2 * tr(E) ** 2 + self._shear_modulus * inner(E, E)

    def in_shear(self, a: Expr, at: At) -> Expr:
        """Return the energy in the simple shear ``gamma^2 = a`` as far as it is linear in `a`."""
        return self._shear_modulus / 2 * a

    @property
    def _shear_modulus(self) -> Any:
        return self.E_MPa / (2 * (1 + self.nu))


class Ogden(Material):
    """One term of Ogden's law in the principal stretches (1972, DOI 10.1098/rspa.1972.0026).

    ``W = 2 mu/alpha^2 (sum_i lambdabar_i^alpha - 3) + (J-1)^2/D1`` with the stretches of
    ``J^(-1/3) F``: `mu` is the shear modulus for any alpha, and alpha = 2 is neo-Hookean.
    """

    law: Literal["ogden"] = "ogden"
    mu_MPa: Positive = Field(description="shear modulus at small strain")
    alpha: Annotated[Finite, Field(ge=-50, le=50), AfterValidator(nonzero)] = Field(
        description="exponent of the stretches"
    )
    D1_per_MPa: Positive = Field(description="2/K, of (J - 1)^2 / D1")

    def energy(self, F: Expr, at: At) -> Expr:
        """Return the strain energy density, in MPa; the same everywhere."""
        from tactile_fem.tissue.energies import invariants  # takes a while
        from tactile_fem.tissue.stretches import sum_of_powers

        J, a, b = invariants(F)
        shape = sum_of_powers(a, b, self.alpha) - 3
        return 2 * self.mu_MPa / self.alpha**2 * shape + (J - 1) ** 2 / self.D1_per_MPa

    def in_shear(self, a: Expr, at: At) -> Expr:
        """Return the energy in the simple shear ``gamma^2 = a``, of stretches s, 1 and 1/s."""
        from tactile_fem.tissue.stretches import chebyshev

        return 4 * self.mu_MPa / self.alpha**2 * (chebyshev(self.alpha / 2, 1 + a / 2) - 1)


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
        with self.law.running(_OWN):
            is_law = hasattr(own, "energy")
            return own.energy(F, at) if is_law else own(F, at, **self.__pydantic_extra__)

    @property
    def in_shear(self) -> Any:
        """The method of the class; AttributeError if it has none."""
        return self._made().in_shear

    def _made(self) -> Any:
        """Return the function, or the object with the constants, which those of forms replace."""
        code, constants = self.law.load(_OWN), self.__pydantic_extra__
        if not isinstance(code, type):
            return code
        with self.law.running(_OWN):
            own = code(**{name: float(value) for name, value in constants.items()})
        for name, value in constants.items():
            object.__setattr__(own, name, value)
        return own


Material.coded = OwnLaw


def _neo_hookean(E_MPa: float, nu: float = 0.48) -> dict[str, float]:
    """Return C10 = G/2 and D1 = 2/K of a neo-Hookean tissue."""
    return {"C10_MPa": E_MPa / (4 * (1 + nu)), "D1_per_MPa": 6 * (1 - 2 * nu) / E_MPa}


# Moduli of the outer layers before the fit, from the literature: stratum corneum E 0.5 MPa, half of
# the least of Geerligs 2011; epidermis and dermis Maeno 1998, dermis' C20 from a plate's force.
# The paper's are neo-Hookean. C30 matters at strains of tens of percent, as caused by a friction
# of 1 or the free end of a stroke.
_SKIN = {
    "stratum_corneum": {"C10_MPa": 0.0845, "C30_MPa": 0.845, "D1_per_MPa": 0.48},
    "epidermis": {"C10_MPa": 0.02297, "C30_MPa": 0.02297, "D1_per_MPa": 1.765},
    "dermis": {"C10_MPa": 0.01351, "C20_MPa": 0.010, "D1_per_MPa": 3.0},
}
_HARD = {"bone": {"E_MPa": 17_000.0, "nu": 0.3}, "nail": {"E_MPa": 170.0, "nu": 0.3}}


def _scaled(factor: float) -> dict[str, dict[str, float]]:
    """Return the outer layers with all moduli times a factor."""
    layers = {layer: Polynomial.model_validate(values) for layer, values in _SKIN.items()}
    return {
        layer: {
            name: float(f"{value:.4g}")
            for name, value in constants.scaled(factor).model_dump(exclude_unset=True).items()
        }
        for layer, constants in layers.items()
    }


TISSUE_SETS: dict[str, dict[str, dict[str, float]]] = {
    # Fitted by `tactile-fem fit`, together with the shape of the pad, to forces on a plate and a
    # probe and to the skin's profile under a cylinder: demos/pages/how/truth.md.
    "fitted": {
        **_scaled(0.355),
        "subcutaneous": {"C10_MPa": 3.25e-4, "C20_MPa": 3.2e-4, "D1_per_MPa": 21.0},
        **_HARD,
    },
    # Fitted to the plate alone, on a more pointed pad; too stiff for the probe.
    "plate": {
        **_SKIN,
        "subcutaneous": {"C10_MPa": 1.1e-4, "C20_MPa": 8.95e-4, "D1_per_MPa": 48.0},
        **_HARD,
    },
    # Proposed: adjusted by hand to the same forces.
    "proposed": {
        **_SKIN,
        "subcutaneous": {"C10_MPa": 4.22e-4, "C20_MPa": 3.0e-4, "D1_per_MPa": 96.0},
        **_HARD,
    },
    # Maeno et al. 1998; stratum corneum E 1 MPa (Geerligs 2011: 1 to 2).
    "maeno1998": {
        "stratum_corneum": _neo_hookean(1.0),
        "epidermis": _neo_hookean(0.136),
        "dermis": _neo_hookean(0.080),
        "subcutaneous": _neo_hookean(0.034),
        **_HARD,
    },
    # Gerling et al. 2014: shear moduli; its epidermis includes the stratum corneum.
    "gerling2014": {
        "stratum_corneum": _neo_hookean(1.212 * 2 * 1.48),
        "epidermis": _neo_hookean(1.212 * 2 * 1.48),
        "dermis": _neo_hookean(0.0507 * 2 * 1.48),
        "subcutaneous": _neo_hookean(0.00237 * 2 * 1.48),
        **_HARD,
    },
}


# Series of the four soft tissues. The times are those of finger pads under a flat probe (Pawluk and
# Howe 1999, DOI 10.1115/1.2835100); the shares are fitted to how a held force falls and what a tap
# loses: demos/pages/how/truth.md.
RELAXATIONS: dict[str, dict[str, tuple[float, ...]]] = {
    "none": {},
    "fingerpad": {"g": (0.28, 0.28, 0.14), "tau_s": (0.004, 0.070, 1.4)},
}


class Tissue(Settings):
    """Constants of the tissues; tables and keys that are left out come from the named set."""

    set: Literal["fitted", "plate", "proposed", "maeno1998", "gerling2014"] = Field(
        "fitted", description="constants of the tissues that are not given below"
    )
    viscous_time_s: NonNegative = Field(
        0.004,
        description="Kelvin-Voigt time, the shortest relaxation time of measured finger pads "
        "(Pawluk and Howe 1999, DOI 10.1115/1.2835100); stabilizes the solver; 0, the default "
        "with relaxation, is none",
    )
    relaxation: Literal["none", "fingerpad"] = Field(
        "none", description="g and tau_s of the soft tissues for which none are given below"
    )
    density_kg_m3: Positive = Field(
        1000.0, description="density of all tissues, as water; for `vibrate` and solver.inertia"
    )
    stratum_corneum: Material
    epidermis: Material
    dermis: Material
    subcutaneous: Material
    bone: Material
    nail: Material

    def materials(self) -> dict[str, Material]:
        """Return laws and constants by the name of the tissue."""
        return {name: value for name, value in self if isinstance(value, Material)}

    def own_laws(self) -> dict[str, Material]:
        """Return those materials whose law is not that of the named sets."""
        return {name: one for name, one in self.materials().items() if one.law != _law_of(name)}

    @model_validator(mode="before")
    @classmethod
    def _fill_from_set(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        name = data.get("set", "fitted")
        known = isinstance(name, str) and name in TISSUE_SETS
        constants = TISSUE_SETS[name if known else "fitted"]
        relaxation = data.get("relaxation", "none")
        series = RELAXATIONS.get(relaxation, {}) if isinstance(relaxation, str) else {}
        filled = {"viscous_time_s": 0.0, **data} if series else dict(data)
        for tissue, values in constants.items():
            given, law = data.get(tissue, {}), _law_of(tissue)
            if isinstance(given, Material):  # complete but for its series
                given, values = {"law": given.law, **given.model_dump(exclude_unset=True)}, {}
            if isinstance(given, dict):
                own = values if given.get("law", law) == law else {}
                relaxes = tissue not in _HARD and not {"g", "tau_s"} & given.keys()
                given = {"law": law, **own, **(series if relaxes else {}), **given}
            filled[tissue] = given
        return filled


def _law_of(tissue: str) -> str:
    """Return the law of a tissue in the named sets."""
    return "elastic" if tissue in _HARD else "polynomial"
