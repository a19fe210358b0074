"""Tolerance bands of a population, estimated from a sample."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError

Array = NDArray[np.float64]

SHARES = (0.5, 0.9)
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Bands:
    """Median and bands of a number or a history over people.

    A band contains another person with its probability, whatever the distribution. Where there are
    too few people for it, it is the range of all people, see `covered`.

    Attributes
    ----------
    median
        (...), NaN where nobody has a value.
    low, high
        Ends of the bands, (shares, ...).
    shares
        Probabilities of the bands.
    people
        How many have a finite value, (...).
    missing
        How many have none at all, such as those whose scan failed.
    """

    median: Array
    low: Array
    high: Array
    shares: tuple[float, ...]
    people: NDArray[np.intp]
    missing: int

    @property
    def covered(self) -> Array:
        """Probabilities that the bands have: the shares, less where people are few, (shares,).

        They are those where the fewest people have a value; where nobody has one does not count.
        """
        few = self.people[self.people > 0].min(initial=np.iinfo(np.intp).max)
        return np.array([covered(share, few) for share in self.shares])


def covered(share: float, people: ArrayLike) -> Array:
    """Return the probability (...) that a band of a share has with so many people, (...)."""
    n = np.maximum(np.asarray(people, dtype=float), 1)
    return np.minimum(share, (n - 1) / (n + 1))


def people_needed(share: float) -> int:
    """Return how many people a band needs: the range of n contains another with (n-1)/(n+1)."""
    return ceil(2 / (1 - share) - 1 - _ROUNDING)


def bands(values: ArrayLike, shares: Sequence[float] = SHARES) -> Bands:
    """Return the median and the bands of people.

    The k-th smallest of n values exceeds that of another person with probability k/(n+1) (Wilks
    1941, Ann. Math. Stat. 12:91), so a band ends at ranks p (n+1) (Weibull's positions). Quantiles
    of the sample itself, at 1 + p (n-1), lie closer together: of 20 people, those of 5 and 95 %
    contain another with 81 %.

    Parameters
    ----------
    values
        (people, ...); those that are not finite are ignored.
    shares
        Probabilities of the bands, between 0 and 1.

    Raises
    ------
    StudyError
        Without people, or for another share.
    """
    found = np.asarray(values, dtype=float)
    if found.ndim == 0 or not len(found):
        raise StudyError("Bands need the values of one person or more, but there are none.")
    for share in shares:
        if not 0 < share < 1:
            raise StudyError(f"The share of a band is {share:g} but must lie between 0 and 1.")
    finite = np.isfinite(found)
    tails = [(1 + sign * share) / 2 for sign in (-1, 1) for share in shares]
    with warnings.catch_warnings(category=RuntimeWarning, action="ignore"):  # nobody has a value
        ends = np.nanquantile(
            np.where(finite, found, np.nan), [0.5, *tails], axis=0, method="weibull"
        )
    some = finite.reshape(len(found), -1).any(axis=1)
    middle = 1 + len(shares)
    return Bands(
        median=ends[0],
        low=ends[1:middle],
        high=ends[middle:],
        shares=tuple(shares),
        people=np.asarray(finite.sum(axis=0)),
        missing=int(np.sum(~some)),
    )


def bands_table(numbers: Mapping[str, ArrayLike], shares: Sequence[float] = SHARES) -> list[Any]:
    """Return rows of text: a heading, and median and bands of each number (people,) by its name.

    Headings have the probabilities that the bands have with the most people of a number. A band
    that has less, as fewer people have this number, is followed by what it has.
    """
    found = {name: bands(values, shares) for name, values in numbers.items()}
    most = max((int(own.people) for own in found.values()), default=0)
    headed = [float(covered(share, most)) for share in shares]
    rows = [["number", "people", "median", *(f"{100 * share:.0f} % of people" for share in headed)]]
    for name, own in found.items():
        missing = f" ({own.missing} without)" if own.missing else ""
        rows.append([name, f"{own.people}{missing}", _text(own.median)])
        for low, high, share, has in zip(own.low, own.high, headed, own.covered, strict=True):
            doubt = f" ({100 * has:.0f} %)" if has < share - _ROUNDING else ""
            rows[-1].append(f"{_text(low)} to {_text(high)}{doubt}" if own.people else _text(low))
    return rows


def _text(value: Any) -> str:
    return f"{float(value):.3g}" if np.isfinite(value) else "\N{EN DASH}"
