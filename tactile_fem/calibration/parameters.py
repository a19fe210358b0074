"""Values of a study that are multiplied by factors: by a fit, or from person to person."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ValidationError

from tactile_fem.errors import StudyError
from tactile_fem.stimulus import Friction
from tactile_fem.study import Study, in_words, suggestion

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
# Tables of a study that a fit may change: its presses depend on no others.
_FITTED = ("tissue", "finger")

Powers = Mapping[tuple[str, ...], float]


@dataclass(frozen=True)
class Parameter:
    """The logarithm x of a factor, 0 at the study's values: each value times ``exp(power x)``.

    Each is called by its keys in the study: a population by its name, an entry of a list by its
    number.
    """

    name: str  # as the user writes it
    powers: Powers
    factor: float  # expected ratio to the study's value before any measurement, at one sd

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
        """Unit of its value; a factor of several values multiplies moduli or lengths."""
        return unit_of(*self.powers) if len(self.powers) == 1 else f"times its {self.multiplied}"

    @property
    def multiplied(self) -> str:
        """What a factor of several values multiplies."""
        return "moduli" if self.of_tissue else "lengths"

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
        if isinstance(found, tuple):
            found = _entry(found, key)
        else:
            fields = getattr(type(found), "model_fields", ())
            found = getattr(found, key) if key in fields else None
    return found


def is_of_file(study: Study, keys: Sequence[str]) -> bool:
    """Return whether a file of the finger takes the place of a value."""
    return keys[0] == "finger" and len(keys) > 1 and keys[1] not in study.finger.model_dump()


def _entry(entries: Sequence[Any], key: str) -> Any:
    """Return an entry of a list by its name or its number; None if there is none."""
    for entry in entries:
        if (entry.get("name") if isinstance(entry, dict) else getattr(entry, "name", None)) == key:
            return entry
    return entries[int(key)] if key.isdecimal() and int(key) < len(entries) else None


def parse_parameter(text: str, study: Study) -> Parameter:
    """Return the parameter ``name`` or ``name:factor`` of a fit.

    Its name is one of `powers_of` in the tables ``tissue`` and ``finger``. Raises StudyError if
    there is no such value, or it is not a positive number in the study.
    """
    name, colon, given = text.partition(":")
    name = name.strip()
    try:
        factor = float(given) if colon else _FACTOR
    except ValueError:
        factor = math.nan
    if not (math.isfinite(factor) and factor > 1):
        raise StudyError(f'parameter {text}: the factor is "{given}" but must be a number above 1.')
    try:
        return Parameter(name, powers_of(name, study, _FITTED), factor)
    except StudyError as error:
        raise StudyError(f"parameter {error}") from None


def powers_of(name: str, study: Study, tables: Collection[str] = Study.model_fields) -> Powers:
    """Return the values of a study that a name stands for, and their powers.

    It is a tissue (all its moduli), ``skin`` (those of stratum corneum, epidermis and dermis),
    ``finger.size`` (its lengths, but not of its ridges), a layer of skin such as ``finger.dermis``
    (its thickness, for which subcutaneous tissue makes room), ``stimulus.friction`` (the
    coefficients of its law), the ``gain`` of a population, such as ``SA1.gain``, or any number
    above 0 by its keys: ``finger.pad_radius_mm``. Before a tissue ``tissue.`` may be left out,
    before a constant of a population's neuron all but the name of the population.

    Raises StudyError, which begins with the name, if there is no such value in these tables of the
    study, or it is not a positive number.
    """
    groups = {
        key: powers for key, powers in _groups(study).items() if {k[0] for k in powers} <= {*tables}
    }
    if groups.get(name):
        return groups[name]
    keys = _keys_of(name, study)
    value = value_at(study, keys) if keys[0] in tables else None
    of_file = keys[0] == "finger" and (
        name in groups or (value is not None and is_of_file(study, keys))
    )
    if (value is None and not of_file) or isinstance(value, BaseModel):
        known = [*filter(groups.get, groups), *_numbers(study, tables)]
        raise StudyError(f"{name}: there is no such value; {suggestion(name, known)}")
    if of_file:
        raise StudyError(f"{name}: it has no effect on a finger that comes from a file.")
    if isinstance(value, int) and not isinstance(value, bool):
        raise StudyError(f"{name}: it is a whole number, which cannot be varied.")
    if not isinstance(value, float) or not value > 0:
        raise StudyError(f"{name}: it is {value} but must be a number above 0.")
    return {keys: 1.0}


def _groups(study: Study) -> dict[str, Powers]:
    """Return the values that a name of several stands for."""
    found: dict[str, Powers] = {}
    for name, tissues in {"skin": _SKIN, **{tissue: (tissue,) for tissue in _TISSUES}}.items():
        found[name] = {  # 1 of a modulus, -1 of an inverse
            ("tissue", tissue, key): float(power)
            for tissue in tissues
            for key, power in getattr(study.tissue, tissue).moduli().items()
        }
    found["finger.size"] = {("finger", *keys): 1.0 for keys in study.finger.size_keys()}
    for layer in _SKIN:
        powers = study.finger.layer_powers(layer)
        found[f"finger.{layer}"] = {("finger", *key): power for key, power in powers.items()}
    if isinstance(law := study.stimulus.friction, Friction):
        found["stimulus.friction"] = {("stimulus", "friction", k): 1.0 for k in law.scaled_by}
    for population in study.populations:
        neuron, gains = _neuron(study, population.name), population.neuron.gain_keys()
        found[f"{population.name}.gain"] = {(*neuron, *key): 1.0 for key in gains}
    return found


def _neuron(study: Study, population: str) -> tuple[str, ...]:
    return ("afferents", population, "neuron") if study.afferents else ("neuron",)


def _keys_of(name: str, study: Study) -> tuple[str, ...]:
    """Return the keys of a name, in full."""
    first, *rest = name.split(".")
    if first in Study.model_fields:
        return (first, *rest)
    if first in {population.name for population in study.populations}:
        return (*_neuron(study, first), *rest)
    return ("tissue", first, *rest)


def _numbers(study: Study, tables: Collection[str]) -> Iterator[str]:
    """Yield the names of single values above 0."""
    for tissue in _TISSUES:
        yield from (f"{tissue}.{key}" for key in _positive(getattr(study.tissue, tissue)))
    yield from (f"finger.{key}" for key in _positive(study.finger))
    if "stimulus" in tables:
        yield from (f"stimulus.{key}" for key in _positive(study.stimulus))
    for population in study.populations if "neuron" in tables else ():
        yield from (f"{population.name}.{key}" for key in _positive(population.neuron))


def with_values(study: Study, parameters: Sequence[Parameter], x: ArrayLike) -> Study:
    """Return the study with each parameter's values times ``exp(power x)``.

    Raises StudyError if the values are not allowed.
    """
    data = study.model_dump(mode="json", exclude_none=True)
    for parameter, log in zip(parameters, np.asarray(x, dtype=float).tolist(), strict=True):
        for keys, power in parameter.powers.items():
            section: Any = data
            for key in keys[:-1]:
                section = _entry(section, key) if isinstance(section, list) else section[key]
            last: Any = int(keys[-1]) if isinstance(section, list) else keys[-1]
            section[last] *= math.exp(power * log)
    try:
        return Study.model_validate(data)
    except ValidationError as error:
        raise StudyError(in_words(error)) from None


def _positive(section: Any) -> list[str]:
    """Return the keys of a section whose values are numbers above 0."""
    values = section.model_dump().items()
    return [name for name, value in values if isinstance(value, float) and value > 0]
