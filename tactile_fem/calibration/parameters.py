"""What a fit may change: constants of the tissues, lengths of the finger."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from tactile_fem.errors import StudyError
from tactile_fem.study import Study
from tactile_fem.study.explain import explain, suggestion

_SKIN = ("stratum_corneum", "epidermis", "dermis")
_TISSUES = (*_SKIN, "subcutaneous", "bone", "nail")
# What a fit changes unless it is told.
DEFAULT_PARAMETERS = (
    "skin",
    "subcutaneous.C10_MPa",
    "subcutaneous.C20_MPa",
    "subcutaneous.D1_per_MPa",
)
_FACTOR = 3.0  # of a parameter for which none is given


@dataclass(frozen=True)
class Parameter:
    """One number of a fit: the logarithm x of a factor, 0 at the study's values.

    Attributes
    ----------
    name
        As the user writes it.
    powers
        Section and key in the study of each value that it changes, and the power: the value times
        ``exp(power x)``.
    factor
        Expected ratio to the study's value before any measurement, at one standard deviation.
    """

    name: str
    powers: Mapping[tuple[str, ...], float]
    factor: float

    @property
    def of_tissue(self) -> bool:
        """Whether it changes only constants of the tissues, which have sensitivities."""
        return all(keys[0] == "tissue" for keys in self.powers)

    @property
    def sd(self) -> float:
        """Standard deviation of x before any measurement."""
        return math.log(self.factor)

    @property
    def change(self) -> dict[tuple[str, str], float]:
        """Tissue and name of the constants, and the powers; for `Sensitivities`."""
        return {(keys[1], keys[2]): power for keys, power in self.powers.items()}

    @property
    def unit(self) -> str:
        """Unit of its value; a factor of several constants multiplies moduli."""
        return unit_of(*self.powers) if len(self.powers) == 1 else "times its moduli"

    def value(self, study: Study) -> float:
        """Return its value in a study; 1 for a factor of several constants."""
        return float(value_at(study, *self.powers)) if len(self.powers) == 1 else 1.0


def unit_of(keys: Sequence[str]) -> str:
    """Return the unit of a value of a study, which its name ends with."""
    ends = {"_per_MPa": "1/MPa", "_MPa": "MPa", "_mm": "mm"}
    return next((unit for end, unit in ends.items() if keys[-1].endswith(end)), "1")


def value_at(study: Study, keys: Sequence[str]) -> Any:
    """Return a value of a study; None if there is none."""
    found: Any = study
    for key in keys:
        fields = getattr(type(found), "model_fields", ())
        found = getattr(found, key) if key in fields else None
    return found


def parse_parameter(text: str, study: Study) -> Parameter:
    """Return the parameter ``name`` or ``name:factor``.

    Its name is a tissue (all its moduli), ``skin`` (those of stratum corneum, epidermis and
    dermis), a constant such as ``subcutaneous.C20_MPa``, or a length such as
    ``finger.pad_radius_mm``.

    Raises
    ------
    StudyError
        There is no such value, or it is not a positive number in the study.
    """
    name, colon, given = text.partition(":")
    name = name.strip()
    try:
        factor = float(given) if colon else _FACTOR
    except ValueError:
        factor = math.nan
    if not (math.isfinite(factor) and factor > 1):
        raise StudyError(f'parameter {text}: the factor is "{given}" but must be a number above 1.')
    if name == "skin" or name in _TISSUES:
        tissues = _SKIN if name == "skin" else (name,)
        powers: dict[tuple[str, ...], float] = {
            ("tissue", tissue, key): float(power)  # 1 of a modulus, -1 of an inverse
            for tissue in tissues
            for key, power in getattr(study.tissue, tissue).moduli().items()
        }
        return Parameter(name, powers, factor)
    section, _, key = name.rpartition(".")
    keys = (section, key) if section == "finger" else ("tissue", section, key)
    value = value_at(study, keys)
    if section == "finger" and value is not None and key not in study.finger.model_dump():
        raise StudyError(f"parameter {name}: it has no effect on a finger that comes from a file.")
    if isinstance(value, int) and not isinstance(value, bool):
        raise StudyError(f"parameter {name}: it is a whole number, which a fit cannot change.")
    if not isinstance(value, float) or not value > 0:
        if value is not None:
            raise StudyError(f"parameter {name}: it is {value} but must be a number above 0.")
        known = ["skin", *_TISSUES]
        for tissue in _TISSUES:
            known += [f"{tissue}.{key}" for key in _positive(getattr(study.tissue, tissue))]
        known += [f"finger.{key}" for key in _positive(study.finger)]
        raise StudyError(f"parameter {name}: there is no such value; {suggestion(name, known)}")
    return Parameter(name, {keys: 1.0}, factor)


def with_values(study: Study, parameters: Sequence[Parameter], x: ArrayLike) -> Study:
    """Return the study with each parameter's values times ``exp(power x)``.

    Raises
    ------
    StudyError
        The values are not allowed.
    """
    data = study.model_dump(exclude_none=True)
    for parameter, log in zip(parameters, np.asarray(x, dtype=float).tolist(), strict=True):
        for keys, power in parameter.powers.items():
            section: Any = data
            for key in keys[:-1]:
                section = section[key]
            section[keys[-1]] *= math.exp(power * log)
    try:
        return Study.model_validate(data)
    except ValidationError as error:
        raise StudyError(explain(error)) from None


def _positive(section: Any) -> list[str]:
    """Return the keys of a section whose values are numbers above 0."""
    values = section.model_dump().items()
    return [name for name, value in values if isinstance(value, float) and value > 0]
