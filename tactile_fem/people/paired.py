"""Two stimuli or conditions compared within people, as experiments do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Estimate

Array = NDArray[np.float64]

_FEWEST = 6  # of whom the range contains the median of all people with 95 %
_FEW = f"fewer than {_FEWEST} people"


@dataclass(frozen=True)
class Paired:
    """How a number of people changes from a first condition to a second one.

    Attributes
    ----------
    people, missing
        How many have both values; how many lack one and are left out.
    difference
        Median of second less first, and its 95 % interval: infinite for fewer than six people.
    ratio
        Likewise of second to first; NaN if one of the values is negative.
    same
        Share of people whose difference has the sign of the median, and its 95 % interval
        (Clopper and Pearson). Who has none counts as another sign.
    p
        Two-sided p of Wilcoxon's signed-rank test; 1 if nobody's values differ.
    """

    people: int
    missing: int
    difference: Estimate
    ratio: Estimate
    same: Estimate
    p: float

    def __str__(self) -> str:
        """Return the result in words."""
        count, same = round(self.same.value * self.people), self.same
        missing = f", {self.missing} left out" if self.missing else ""
        ratio = "" if np.isnan(self.ratio.value) else f", ratio {_words(self.ratio)}"
        return (
            f"difference {_words(self.difference)}{ratio}; the same sign in {count} of "
            f"{self.people} people ({100 * same.value:.0f} %, {100 * same.low:.0f} to "
            f"{100 * same.high:.0f} %){missing}; p = {self.p:.2g}"
        )


def paired(first: ArrayLike, second: ArrayLike) -> Paired:
    """Compare two numbers of the same people.

    Intervals of medians are those between two of the people's values (of order statistics).

    Parameters
    ----------
    first, second
        (people,) each; people with a value that is not finite are left out.

    Raises
    ------
    StudyError
        If nobody has both values, or their numbers differ.
    """
    from scipy.stats import binomtest, wilcoxon  # takes a while

    a, b = (np.asarray(values, dtype=float) for values in (first, second))
    if a.ndim != 1 or a.shape != b.shape:
        raise StudyError(
            f"A paired comparison needs two values of each person, but there are {a.size} first "
            f"and {b.size} second ones."
        )
    both = np.isfinite(a) & np.isfinite(b)
    if not both.any():
        raise StudyError("A paired comparison needs a person with both values, but nobody has.")
    a, b = a[both], b[both]
    change = b - a
    difference = _median(change)
    same = int(np.sum(np.sign(change) == np.sign(difference.value))) if difference.value else 0
    share = binomtest(same, len(a)).proportion_ci(0.95, "exact")
    return Paired(
        people=len(a),
        missing=int(np.sum(~both)),
        difference=difference,
        ratio=_median(_ratios(a, b)),
        same=Estimate(same / len(a), share.low, share.high),
        p=float(wilcoxon(change, zero_method="zsplit").pvalue) if change.any() else 1.0,
    )


def _ratios(a: Array, b: Array) -> Array:
    """Return ratios of values that are not negative; that of two zeros is 1."""
    if min(a.min(), b.min()) < 0:
        return np.full(len(a), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(a == b, 1.0, b / a)


def _median(values: Array) -> Estimate:
    from scipy.stats import quantile_test

    if np.isnan(values).any():
        return Estimate(np.nan, np.nan, np.nan, "negative values")
    ends = quantile_test(values, q=0, p=0.5).confidence_interval(0.95)
    low, high = (end if np.isfinite(end) else np.inf * sign
                 for end, sign in zip(ends, (-1, 1), strict=True))  # fmt: skip
    few = _FEW if len(values) < _FEWEST else ""
    return Estimate(float(np.median(values)), float(low), float(high), few)


def _words(estimate: Estimate) -> str:
    between = estimate.doubt or f"{estimate.low:.3g} to {estimate.high:.3g}"
    return f"{estimate.value:.3g} ({between})"
