"""Sums of a line and exponentials: where they vanish, to rounding, for many at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
_ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True)
class ExponentialSum:
    """The functions p + q s + sum_j c_j exp(-s/tau_j), one per column.

    Parameters
    ----------
    constant, slope
        p and q, (n,).
    amplitudes
        c_j, (k, n).
    times
        tau_j, (k,), all different.
    """

    constant: Array
    slope: Array
    amplitudes: Array
    times: Array

    def of(self, which: Array) -> ExponentialSum:
        """Return some of the columns."""
        return ExponentialSum(
            self.constant[which], self.slope[which], self.amplitudes[:, which], self.times
        )

    def at(self, s: Any) -> Array:
        """Return the values at `s`, a number or (n,) or (m, n)."""
        value = self.constant + self.slope * s
        for amplitude, tau in zip(self.amplitudes, self.times, strict=True):
            value = value + amplitude * np.exp(-s / tau)
        return value

    def rate(self, s: Any) -> Array:
        """Return the derivatives at `s`."""
        value = self.slope + np.zeros_like(s)
        for amplitude, tau in zip(self.amplitudes, self.times, strict=True):
            value = value - amplitude / tau * np.exp(-s / tau)
        return value

    def from_(self, s: Array) -> ExponentialSum:
        """Return the same functions counted from `s` on, (n,)."""
        kept = np.exp(-s / self.times[:, None])
        return ExponentialSum(
            self.constant + self.slope * s, self.slope, self.amplitudes * kept, self.times
        )

    def bounds(self, s: Any) -> tuple[Array, Array]:
        """Return a lower and an upper bound on [0, s]: those of the terms added up."""
        end = self.constant + self.slope * s
        low, high = np.minimum(self.constant, end), np.maximum(self.constant, end)
        for amplitude, tau in zip(self.amplitudes, self.times, strict=True):
            last = amplitude * np.exp(-s / tau)
            low, high = low + np.minimum(amplitude, last), high + np.maximum(amplitude, last)
        return low, high

    def size(self, s: Array) -> Array:
        """Return how large the terms are on [0, s], which sets what rounding does."""
        return np.abs(self.constant) + np.abs(self.slope) * s + np.abs(self.amplitudes).sum(axis=0)

    def zeros(self, end: Array) -> Array:
        """Return in rising order where the functions change sign in (0, end), (k + 1, n).

        Between two zeros of f' + f/tau the function f exp(s/tau) is monotone, so it changes its
        sign there at most once; and that sum has one exponential less than f. A function with
        fewer zeros than k + 1 has its end, (n,), in their place.
        """
        if not len(self.times):
            with np.errstate(divide="ignore", invalid="ignore"):
                zero = -self.constant / self.slope
            return np.where((zero > 0) & (zero < end), zero, end)[None]
        decay = 1 / self.times[-1]
        fewer = ExponentialSum(
            self.slope + decay * self.constant,
            decay * self.slope,
            self.amplitudes[:-1] * (decay - 1 / self.times[:-1, None]),
            self.times[:-1],
        )
        breaks = np.concatenate([np.zeros((1, len(end))), fewer.zeros(end), end[None]])
        negative = self.at(breaks) < 0
        row, column = np.nonzero(negative[1:] != negative[:-1])
        zeros = np.repeat(end[None], len(breaks) - 1, axis=0)
        changing = self.of(column)
        zeros[row, column] = root(
            lambda s: (changing.at(s), changing.rate(s)),
            breaks[row, column],
            breaks[row + 1, column],
            rising=negative[row, column],
            size=changing.size(end[column]),
        )
        return np.sort(zeros, axis=0)


def root(
    function: Callable[[Array], tuple[Array, Array]],
    low: Array,
    high: Array,
    *,
    rising: Array,
    size: Array,
    start: Array | None = None,
) -> Array:
    """Return to rounding where functions change sign between `low` and `high`.

    Newton's method, with a bisection where it leaves the bracket or does not halve its step.

    Parameters
    ----------
    function
        Returns values and derivatives at (n,) places.
    low, high
        The brackets, (n,).
    rising
        Whether a function is below zero at `low`, (n,).
    size
        Size of the terms that make up the values: they are zero where they are rounding of it.
    start
        First guess.
    """
    x = 0.5 * (low + high) if start is None else np.minimum(np.maximum(start, low), high)
    before = high - low
    shortest = _ROUNDING * np.maximum(np.abs(low), np.abs(high))
    done = np.zeros(len(x), dtype=bool)
    last_slope = np.full(len(x), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(200):
            value, slope = function(x)
            done |= np.abs(value) <= _ROUNDING * size
            beyond = (value >= 0) == rising
            low, high = np.where(beyond, low, x), np.where(beyond, x, high)
            guess = x - value / slope
            step = np.abs(guess - x)
            good = (guess >= low) & (guess <= high) & (step <= 0.5 * before)
            # What Newton's step leaves, from how the slope has changed over the step before.
            left = step**2 * np.abs((slope - last_slope) / (before * slope))
            # What is found stays, so that none depends on how long the others take.
            guess = np.where(done, x, np.where(good, guess, 0.5 * (low + high)))
            done |= good & (left <= shortest)
            before, x, last_slope = np.abs(guess - x), guess, slope
            done |= before <= shortest
            if done.all():
                break
    return x
