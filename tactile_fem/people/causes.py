"""Which constants the spread between people comes from: shares of the variance of a number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.hermite_e import hermevander
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import factorial, ndtri

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Estimate

Array = NDArray[np.float64]

REST = "jointly or otherwise"
# Highest polynomial, and people for each of its terms from the second degree on.
_HIGHEST, _PEOPLE_PER_TERM = 3, 2
_RESAMPLES = 1000
_CHANCE = 1e-3  # that independent scores pass for correlated ones
_ROUNDING = 1e-10  # of eigenvalues and of the spread, relative


@dataclass(frozen=True)
class Causes:
    """Shares of the constants in the variance of a number, see `causes`.

    Attributes
    ----------
    shares
        Share of each constant, by its name, with its 95 % interval; NaN if all values are equal.
    rest
        What is left: constants acting jointly, a higher degree, others than those given. Its
        interval reaches `1 - predicted`: resampled people are fitted too well.
    predicted
        Share of the variance of people that were left out which the polynomial predicts (leaving
        out one at a time); below `1 - rest` and even negative where people are too few.
    degree
        Degree of the polynomial in each constant.
    people, missing
        How many have a value; how many have none and are left out.
    """

    shares: Mapping[str, Estimate]
    rest: Estimate
    predicted: float
    degree: int
    people: int
    missing: int

    @property
    def ordered(self) -> list[tuple[str, Estimate]]:
        """Names and shares, the largest first."""
        return sorted(self.shares.items(), key=lambda item: -item[1].value)


def causes(
    scores: ArrayLike,
    names: Sequence[str],
    values: ArrayLike,
    seed: int = 0,
    *,
    independent: bool = False,
) -> Causes:
    """Return the first-order Sobol indices of normal scores.

    Of scores that correlate, they are those of the independent ones behind them: each counts for
    what it adds to those before it (Mara and Tarantola 2012, Reliab. Eng. Syst. Saf. 107:115). The
    first has all that it shares with others, so their order matters.

    They come from a sum of polynomials of one score each, in Hermite's polynomials, which are
    orthonormal for such scores (polynomial chaos; Sudret 2008, Reliab. Eng. Syst. Saf. 93:964).
    Of degrees 1 to 3, the one that best predicts people left out is taken. A term's share is its
    coefficient times its covariance with the number (Pratt), less what noise adds on average; with
    the rest, they add up to 1. Intervals are percentiles over resampled people. Numbers that differ
    by factors should be given as logarithms: otherwise the largest values decide.

    Parameters
    ----------
    scores
        (people, constants), standard normal. One that is the same in all people has no share.
    names
        Names of the constants.
    values
        (people,); people whose values or scores are not finite are left out.
    seed
        Seed of the resampling.
    independent
        Whether the scores are known to be independent, as `Ensemble.draws` are. By default, those
        that correlate by more than chance are taken as correlated.

    Raises
    ------
    StudyError
        If sizes differ, or there are not two people more than constants.
    """
    x, y = np.asarray(scores, dtype=float), np.asarray(values, dtype=float)
    if x.ndim != 2 or x.shape != (y.size, len(names)):
        raise StudyError(
            f"The scores have the shape {x.shape} but need a row for each of {y.size} people and "
            f"a column for each of {len(names)} constants."
        )
    known = np.isfinite(y) & np.isfinite(x).all(axis=1)
    x, y = x[known], y[known]
    if len(y) < len(names) + 2:
        raise StudyError(
            f"There are values of {len(y)} people but the causes of their spread need "
            f"{len(names) + 2} or more, for {len(names)} constants."
        )
    x, y = x if independent else _independent(x), y - y.mean()
    y = y / y.std() if y.std() > _ROUNDING * np.abs(np.asarray(values)[known]).max() else y * np.nan
    degrees = range(1, _HIGHEST + 1)
    fits = [_Fit(x, y, d) for d in degrees if d == 1 or _enough(len(y), len(names) * d + 1)]
    best = max(fits, key=lambda fit: fit.predicted)
    weights = np.random.default_rng(seed).multinomial(
        len(y), np.full(len(y), 1 / len(y)), _RESAMPLES
    )
    found, resampled = best.shares(np.ones((1, len(y))))[0], best.shares(weights)
    estimates = [_estimate(*pair) for pair in zip(found, resampled.T, strict=True)]
    rest = _estimate(1 - found.sum(), 1 - resampled.sum(axis=1))
    return Causes(
        shares=dict(zip(names, estimates, strict=True)),
        rest=replace(rest, high=max(rest.high, min(1.0, 1 - best.predicted))),
        predicted=best.predicted,
        degree=best.degree,
        people=len(y),
        missing=int(np.sum(~known)),
    )


def _independent(x: Array) -> Array:
    """Return what scores (n, k) add to those before them that they correlate with, standard.

    Pairs that correlate by chance would make many groups of few people one.
    """
    n, k = x.shape
    with np.errstate(divide="ignore", invalid="ignore"):  # one is the same in all people
        r = np.nan_to_num(np.corrcoef(x, rowvar=False)).reshape(k, k)
    pairs = max(k * (k - 1) / 2, 1)
    chance = np.tanh(-ndtri(_CHANCE / (2 * pairs)) / np.sqrt(max(n - 3, 1)))  # Fisher's z
    _, group = connected_components(np.abs(r) > chance)
    found = x.copy()
    for j in range(k):
        before = np.flatnonzero(group[:j] == group[j])
        if before.size:
            known = np.column_stack([np.ones(n), x[:, before]])
            added = x[:, j] - known @ np.linalg.lstsq(known, x[:, j])[0]
            found[:, j] = added / sd if (sd := added.std()) > _ROUNDING else 0.0
    return found


def _enough(people: int, terms: int) -> bool:
    return people >= _PEOPLE_PER_TERM * terms


class _Fit:
    """Least squares of standardized values (n,) by polynomials of a degree in each score (n, k)."""

    def __init__(self, x: Array, y: Array, degree: int) -> None:
        terms = hermevander(x, degree)[..., 1:] / np.sqrt(factorial(np.arange(1, degree + 1)))
        self._terms = np.column_stack([np.ones(len(x)), terms.reshape(len(x), -1)])
        self._y, self.degree = y, degree
        self.predicted = self._predicted()

    def _predicted(self) -> float:
        """Return 1 less the squared errors of people left out, in proportion to those of means."""
        if np.isnan(self._y).any():
            return np.nan
        hat = self._terms @ np.linalg.pinv(self._terms)
        errors = (self._y - hat @ self._y) / np.maximum(1 - np.diag(hat), _ROUNDING)
        n = len(self._y)
        return float(1 - np.mean(errors**2) * (1 - 1 / n) ** 2)

    def shares(self, weights: NDArray[np.number]) -> Array:
        """Return the shares (samples, k) for people that count several times, (samples, n)."""
        if np.isnan(self._y).any():
            return np.full((len(weights), (self._terms.shape[1] - 1) // self.degree), np.nan)
        (n, p), a, y = self._terms.shape, self._terms, self._y
        squares = (weights @ (a[:, :, None] * a[:, None]).reshape(n, -1)).reshape(-1, p, p)
        inverse = np.linalg.pinv(squares, rcond=_ROUNDING, hermitian=True)
        products = (weights * y) @ a
        coefficients = np.einsum("bij,bj->bi", inverse, products)
        square, mean = weights @ y**2, weights @ y / n
        noise = np.maximum(square - np.sum(coefficients * products, axis=1), 0) / (n - p)
        variance = square / n - mean**2
        variance[variance < _ROUNDING] = np.nan  # the same person again and again
        covariance = products / n - (weights @ a) / n * mean[:, None]
        each = (coefficients * covariance - noise[:, None] / n)[:, 1:] / variance[:, None]
        return each.reshape(len(weights), -1, self.degree).sum(axis=2)


def _estimate(value: float, resampled: Array) -> Estimate:
    if np.isnan(value):
        return Estimate(np.nan, np.nan, np.nan, "all values are equal")
    low, high = np.nanquantile(resampled, [0.025, 0.975])
    ends = np.clip([value, min(low, value), max(high, value)], 0, 1).tolist()
    return Estimate(ends[0], ends[1], ends[2])


def causes_table(numbers: Mapping[str, Causes], largest: int = 3) -> list[list[str]]:
    """Return rows of text: a heading, and the largest causes of each number by its name."""
    heading = ["number", "people", *(f"cause {k + 1}" for k in range(largest)), REST, "predicted"]
    rows = [heading]
    for name, own in numbers.items():
        known = not np.isnan(own.predicted)
        top = [f"{cause} {_percent(share)}" for cause, share in own.ordered[:largest] if known]
        top += ["\N{EN DASH}"] * (largest - len(top))
        predicted = f"{100 * own.predicted:.0f} %" if known else "\N{EN DASH}"
        people = f"{own.people} ({own.missing} without)" if own.missing else str(own.people)
        rows.append([name, people, *top, _percent(own.rest), predicted])
    return rows


def _percent(share: Estimate) -> str:
    if np.isnan(share.value):
        return "\N{EN DASH}"
    return f"{100 * share.value:.0f} % ({100 * share.low:.0f} to {100 * share.high:.0f})"
