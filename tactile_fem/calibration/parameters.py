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

SKIN = ("stratum_corneum", "epidermis", "dermis")
_TISSUES = (*SKIN, "subcutaneous", "bone", "nail")
# How far a constant may be from the study's value, as a factor at one standard deviation.
USUAL_FACTOR = 3.0


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
        How far the value may be from the study's before any measurement, as a factor at one
        standard deviation.
    """

    name: str
    powers: Mapping[tuple[str, ...], float]
    factor: float

    @property
    def of_tissue(self) -> bool:
        """Whether it changes constants of the tissues alone, which have sensitivities."""
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
        """Unit of its value; that of a factor of several constants says what it multiplies."""
        if len(self.powers) > 1:
            return "times its moduli"
        return unit_of(next(iter(self.powers)))

    def value(self, study: Study) -> float:
        """Return its value in a study; 1 for a factor of several constants."""
        if len(self.powers) > 1:
            return 1.0
        return float(value_at(study, next(iter(self.powers))))


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
        factor = float(given) if colon else USUAL_FACTOR
    except ValueError:
        factor = math.nan
    if not (math.isfinite(factor) and factor > 1):
        raise StudyError(f'parameter {text}: the factor is "{given}" but must be a number above 1.')
    if name == "skin" or name in _TISSUES:
        tissues = SKIN if name == "skin" else (name,)
        powers = {key: power for tissue in tissues for key, power in _moduli(study, tissue).items()}
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
        known = ["skin", *_TISSUES, *_constants(study), *_lengths(study)]
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


def _moduli(study: Study, tissue: str) -> dict[tuple[str, ...], float]:
    """Return the keys of a tissue's moduli, whose power is 1, and of their inverses, -1."""
    moduli = getattr(study.tissue, tissue).moduli()
    return {("tissue", tissue, name): float(power) for name, power in moduli.items()}


def _constants(study: Study) -> list[str]:
    return [
        f"{tissue}.{name}"
        for tissue in _TISSUES
        for name, value in getattr(study.tissue, tissue)
        if isinstance(value, float) and value > 0
    ]


def _lengths(study: Study) -> list[str]:
    lengths = study.finger.model_dump().items()
    return [f"finger.{name}" for name, value in lengths if isinstance(value, float) and value > 0]
