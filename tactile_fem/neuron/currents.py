"""Currents, stretch by stretch: sums of a line and exponentials, and where they vanish."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
_ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True)
class ExponentialSum:
    """The functions ``p + q s + sum_j c_j exp(-s/tau_j)``, one per column.

    `constant` p and `slope` q are (n,), `amplitudes` c_j (k, n), and `times` tau_j (k,), all
    different.
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

    def scaled(self, factors: Array) -> ExponentialSum:
        """Return the functions multiplied by factors, (n,)."""
        p, q, c = self.constant * factors, self.slope * factors, self.amplitudes * factors
        return ExponentialSum(p, q, c, self.times)

    def plus(self, constants: Array) -> ExponentialSum:
        """Return the functions with constants added, (n,)."""
        return replace(self, constant=self.constant + constants)

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
        """Return the same functions of the time since `s`, (n,)."""
        kept = np.exp(-s / self.times[:, None])
        return ExponentialSum(
            self.constant + self.slope * s, self.slope, self.amplitudes * kept, self.times
        )

    def bounds(self, s: Any) -> tuple[Array, Array]:
        """Return a lower and an upper bound on [0, s]: the sums of those of the terms."""
        end = self.constant + self.slope * s
        low, high = np.minimum(self.constant, end), np.maximum(self.constant, end)
        for amplitude, tau in zip(self.amplitudes, self.times, strict=True):
            last = amplitude * np.exp(-s / tau)
            low, high = low + np.minimum(amplitude, last), high + np.maximum(amplitude, last)
        return low, high

    def zeros(self, end: Array) -> Array:
        """Return where the functions change sign in (0, end), increasing, (k + 1, n).

        Between two zeros of f' + f/tau the function f exp(s/tau) is monotonic, so f changes sign
        there at most once; and f' + f/tau has one exponential less than f. A function with fewer
        than k + 1 zeros has its end, (n,), in their place.
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
        size = np.abs(changing.constant) + np.abs(changing.slope) * end[column]
        zeros[row, column] = root(
            lambda s: (changing.at(s), changing.rate(s)),
            breaks[row, column],
            breaks[row + 1, column],
            rising=negative[row, column],
            size=size + np.abs(changing.amplitudes).sum(axis=0),
        )
        return np.sort(zeros, axis=0)


def root(
    function: Callable[[Array], tuple[Array, Array]],
    low: Array,
    high: Array,
    *,
    rising: Any,
    size: Array,
    start: Array | None = None,
) -> Array:
    """Return where functions change sign between `low` and `high`, to rounding, (n,).

    Newton's method, with a bisection where it leaves the bracket or does not halve its step. The
    iterations of one function do not depend on those of the others. `function` returns values and
    derivatives at (n,) places, `rising` says whether a function is negative at `low`, and `size` is
    the magnitude of the terms of the values, which sets their rounding.
    """
    x = 0.5 * (low + high) if start is None else np.clip(start, low, high)
    last_step = high - low
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
            good = (guess >= low) & (guess <= high) & (step <= 0.5 * last_step)
            guess = np.where(done, x, np.where(good, guess, 0.5 * (low + high)))
            # The error after a Newton step, from the change of the slope over the step before.
            error = step**2 * np.abs((slope - last_slope) / (last_step * slope))
            done |= good & (error <= shortest)
            last_step, x, last_slope = np.abs(guess - x), guess, slope
            done |= last_step <= shortest
            if done.all():
                break
    return x


class Segment(NamedTuple):
    """A stretch of time with one expression for the current.

    `start_s` and `length_s` are numbers, or (n,) where the stretches of receptors differ. The
    current is a function of the time since the start. `who` selects the receptors; the membranes of
    all have been advanced to the start.
    """

    start_s: Any
    length_s: Any
    current_pA: ExponentialSum
    who: Any = slice(None)


class Transduction(Protocol):
    """A model of transduction."""

    def segments(self, time_s: Array, drive: Array, /) -> Iterator[Segment]:
        """Yield the current that a history (t,), (t, receptors) evokes, in order.

        The history is linear between its samples; the current is exact.
        """
        ...
