"""What varies between people in a study: parameters, how each is distributed, correlations."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_fem.calibration import (
    Parameter,
    Posterior,
    is_of_file,
    powers_of,
    value_at,
    with_values,
)
from tactile_fem.errors import StudyError
from tactile_fem.people.settings import PRIORS, PRIORS_OF_NEURON, People, Spread, people_of
from tactile_fem.study import Study, suggestion

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Varied:
    """What varies between people about a study.

    Attributes
    ----------
    study
        Study of the middle of people: with the means of `people.fit`, and without `people`.
    parameters, spreads
        What varies, by name, and how. Those of a fit come first; what is fixed is among them.
    fixed
        Names of what does not vary.
    correlation
        Correlation of the parameters of the fit, which come first, (k, k).
    """

    study: Study
    parameters: Mapping[str, Parameter]
    spreads: Mapping[str, Spread]
    fixed: frozenset[str]
    correlation: Array

    @classmethod
    def of(cls, study: Study) -> Varied:
        """Return what varies about a study.

        A shipped spread is left out if the study has no such value, or `people.fit` or
        `people.spread` vary all its values.

        Raises
        ------
        StudyError
            A name stands for no positive number, a distribution allows negative values, the file of
            the fit cannot be used, or nothing varies.
        """
        asked = people_of(study) or People()
        posterior = None if asked.fit is None else _posterior(asked.fit, study)
        middle = study.model_copy(update={"people": None})
        parameters: dict[str, Parameter] = {}
        spreads: dict[str, Spread] = {}
        if posterior is not None:
            middle = _with_means(middle, posterior, asked.fixed)
            for parameter, sd in zip(posterior.parameters, posterior.sd.tolist(), strict=True):
                parameters[parameter.name] = parameter
                spreads[parameter.name] = Spread(factor=math.exp(sd))
        for name, spread in asked.spread.items():
            if name in parameters:
                raise StudyError(f"people.spread.{name}: people.fit varies it already.")
            parameters[name] = _parameter(name, spread, middle)
            spreads[name] = spread
        _add_shipped(parameters, spreads, middle)
        _check_fixed(asked.fixed, parameters, _shipped(middle))
        correlation = np.empty((0, 0)) if posterior is None else posterior.correlation
        return cls(middle, parameters, spreads, frozenset(asked.fixed), correlation)

    def person(self, scores: Mapping[str, float]) -> tuple[Study, dict[str, float]]:
        """Return the study of a person with standard scores by name, and the values by name.

        Of several values at once it is their common factor. Scores of other names are ignored.

        Raises
        ------
        StudyError
            The study does not allow the values.
        """
        names = [name for name in self.parameters if name not in self.fixed]
        each = [self.parameters[name] for name in names]
        x = [self.spreads[p.name].log_ratio(scores[p.name], p.value(self.study)) for p in each]
        values = {
            p.name: p.value(self.study) * math.exp(log) for p, log in zip(each, x, strict=True)
        }
        return with_values(self.study, each, x), values


def _posterior(file: Path, study: Study) -> Posterior:
    found = Posterior.load(file, f"people.fit = {file}")
    for parameter in found.parameters:
        for keys in parameter.powers:
            if not isinstance(value_at(study, keys), float) or is_of_file(study, keys):
                raise StudyError(
                    f"people.fit = {file} varies {'.'.join(keys)}, which this study does not have."
                )
    return found


def _with_means(study: Study, posterior: Posterior, fixed: tuple[str, ...]) -> Study:
    """Return the study with the fitted values, but for those that are fixed."""
    for k, parameter in enumerate(posterior.parameters):
        if parameter.name in fixed:
            continue
        for keys, value in posterior.mean(k).items():
            now = value_at(study, keys)
            if not value * now > 0:
                raise StudyError(
                    f"people.fit gives {'.'.join(keys)} = {value:g} but the study {now:g}: both "
                    "must have the same sign."
                )
            one = Parameter(parameter.name, {keys: 1.0}, parameter.factor)
            study = with_values(study, [one], [math.log(value / now)])
    return study


def _parameter(name: str, spread: Spread, study: Study) -> Parameter:
    try:
        parameter = Parameter(name, powers_of(name, study), spread.factor or math.e)
    except StudyError as error:
        raise StudyError(f"people.spread.{error}") from None
    if problem := spread.problem(parameter.value(study)):
        raise StudyError(f"people.spread.{name}: {problem}.")
    return parameter


def _add_shipped(
    parameters: dict[str, Parameter], spreads: dict[str, Spread], study: Study
) -> None:
    """Add the shipped spreads of what the study has and nothing else varies."""
    varied = {keys for parameter in parameters.values() for keys in parameter.powers}
    for name, factor in _shipped(study).items():
        spread = Spread(factor=factor)
        try:
            parameter = _parameter(name, spread, study)
        except StudyError as error:
            logger.info("the same in all people: %s", error)
            continue
        own = {keys for keys, power in parameter.powers.items() if power > 0}
        if name not in parameters and not own <= varied:
            parameters[name], spreads[name] = parameter, spread


def _shipped(study: Study) -> dict[str, float]:
    of_neurons = {
        f"{population.name}.{key}": factor
        for population in study.populations
        for key, factor in PRIORS_OF_NEURON.items()
    }
    return {**PRIORS, **of_neurons}


def _check_fixed(
    fixed: tuple[str, ...], parameters: Mapping[str, Parameter], shipped: Mapping[str, float]
) -> None:
    for name in fixed:
        if name not in (known := {**parameters, **shipped}):
            raise StudyError(f"people.fixed: {name} varies in no case; {suggestion(name, known)}")
    if not parameters.keys() - set(fixed):
        raise StudyError("people.fixed holds all that varies: leave something out of it.")
