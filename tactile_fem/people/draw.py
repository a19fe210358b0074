"""Draws people: standard scores from a low-discrepancy sequence, and the studies of their fingers.

Scores are those of a scrambled Sobol' sequence through the inverse of the normal distribution
(Owen 1998). Scores of fitted parameters are then correlated by the Cholesky factor of their
correlations. The first n people of a larger ensemble are the ensemble of n.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from tactile_fem.errors import StudyError, raise_all
from tactile_fem.people.settings import MOST_SD, People, people_of
from tactile_fem.people.spread import Varied
from tactile_fem.series import Member
from tactile_fem.simulation import check
from tactile_fem.study import Study

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Person(Member):
    """A scan of an ensemble: one person in one condition; `values` has those of both."""

    person: str
    condition: str  # empty if there is one only
    scores: dict[str, float] = field(default_factory=dict)  # standard scores of what varies
    draws: dict[str, float] = field(default_factory=dict)  # behind those of a fit


def people(conditions: Study | Sequence[Member], number: int) -> list[Person]:
    """Return the scans of an ensemble: fingers drawn from the distribution of the study.

    The distribution is that of the study's table ``people``, by default the shipped one. Each
    person's study contains the person's values and no such table.

    Parameters
    ----------
    conditions
        A study, or several such as those of `tactile_fem.series.sweep`: the same people are drawn
        for each.
    number
        Number of people.

    Returns
    -------
    list
        ``person-001`` and so on; with several conditions all of one person, then of the next,
        ``person-001_text-C``.

    Raises
    ------
    StudyError
        Bad input, see `tactile_fem.study.People`; the finger of the study itself cannot be pressed,
        or a person's value is not allowed in a study.
    """
    if number < 1:
        raise StudyError(f"number is {number} but must be 1 or more people.")
    if isinstance(conditions, Study):
        conditions = [Member("", conditions, {})]
    if any(people_of(one.study) != people_of(conditions[0].study) for one in conditions):
        raise StudyError("people differs between the conditions: vary what is not in its table.")
    each = [Varied.of(one.study) for one in conditions]
    raise_all(*(partial(check, varied.study) for varied in each))
    names = list(dict.fromkeys(name for varied in each for name in varied.parameters))
    seed = (people_of(conditions[0].study) or People()).seed
    drawn = standard_scores(number, len(names), seed, each[0].correlation)
    free = [j for j in range(len(each[0].correlation)) if names[j] not in each[0].fixed]
    lower = np.linalg.cholesky(each[0].correlation[np.ix_(free, free)])
    independent = np.linalg.solve(lower, drawn[:, free].T).T.tolist()
    found = []
    for k, row in enumerate(drawn.tolist(), 1):
        scores = dict(zip(names, row, strict=True))
        shown = {name: z for name, z in scores.items() if name not in each[0].fixed}
        for condition, varied in zip(conditions, each, strict=True):
            person = f"person-{k:03d}"
            name = f"{person}_{condition.name}" if condition.name else person
            try:
                study, values = varied.person(scores)
            except StudyError as error:
                raise StudyError(f"{name}: {error}") from None
            own = {**condition.values, **{key: float(f"{v:.6g}") for key, v in values.items()}}
            output = study.output.model_copy(update={"pictures": False})
            study = study.model_copy(update={"output": output})
            draws = {names[j]: z for j, z in zip(free, independent[k - 1], strict=True)}
            found.append(Person(name, study, own, person, condition.name, shown, draws))
    return found


def standard_scores(number: int, count: int, seed: int, correlation: Array | None = None) -> Array:
    """Return standard normal scores, (number, count), within 5 standard deviations.

    The first ones have the correlation, (k, k); the others are independent.
    """
    sobol = qmc.Sobol(count, scramble=True, seed=np.random.default_rng(seed))
    uniform = sobol.random_base2(math.ceil(math.log2(number)))[:number]
    scores = ndtri(uniform)  # 0 is -inf
    if correlation is not None and len(correlation):
        k = len(correlation)
        limited = np.clip(scores[:, :k], -MOST_SD, MOST_SD)
        scores[:, :k] = limited @ np.linalg.cholesky(correlation).T
    return np.clip(scores, -MOST_SD, MOST_SD)
