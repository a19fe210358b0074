"""Membrane: leaky integrate-and-fire neurons with absolute refractoriness, exact in time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.transduction import Piece
from tactile_fem.study import Neuron

Array = NDArray[Any]


class Membrane:
    """Membranes of all receptors, advanced together.

    Proposed: the form of Hamasaki et al. (2020) as reconstructed, with a number of our own::

        C dV/dt = -V/R + I;   V >= V_th: spike, then V = 0 for t_ref      (5)

    For a current linear within a step the potential is known in closed form: steps without
    events cost one multiplication; threshold crossings (also those that turn back before the end
    of the step) and the end of refractoriness are located inside the step. A negative current
    drives V below 0 without a floor.

    Parameters
    ----------
    receptors
        How many.
    neuron
        The constants; pF GOhm = ms, pA GOhm = mV.
    """

    def __init__(self, receptors: int, neuron: Neuron) -> None:
        self._resistance = neuron.resistance_GOhm
        self._threshold = neuron.threshold_mV
        self._refractory = neuron.refractory_s
        self._tau = 1e-3 * neuron.resistance_GOhm * neuron.capacitance_pF
        self._potential = np.zeros(receptors)
        self._free = np.full(receptors, -np.inf)  # end of refractoriness, s
        self._fired: list[tuple[Array, Array]] = []

    def advance(self, piece: Piece) -> None:
        """Advance through steps that follow the last ones."""
        first, last = self._resistance * piece.first_pA, self._resistance * piece.last_pA
        h = piece.step_s[:, None]
        gone = -np.expm1(-h / self._tau)
        drive = first * gone + (last - first) * (1 - self._tau / h * gone)
        kept = 1 - gone[:, 0]
        turning = (first > self._threshold) & (last < self._threshold)
        turns = turning.any(axis=1)
        for k, start in enumerate(piece.start_s):
            end = kept[k] * self._potential + drive[k]
            event = (end >= self._threshold) | (self._free > start)
            if turns[k]:
                event |= turning[k]
            who = np.flatnonzero(event)
            if who.size:
                end[who] = self._eventful(who, start, piece.step_s[k], first[k, who], last[k, who])
            self._potential = end

    def _eventful(self, who: Array, start: float, h: float, first: Array, last: Array) -> Array:
        """Return V at the end of a step in which `who` may fire or become free."""
        slope = (last - first) / h
        begin = np.clip(self._free[who] - start, 0.0, h)
        v = np.where(self._free[who] > start, 0.0, self._potential[who])
        result = np.zeros(len(who))
        going = np.flatnonzero(begin < h)
        while going.size:
            course = Course(
                v[going],
                first[going] + slope[going] * begin[going],
                slope[going],
                self._tau,
            )
            left = h - begin[going]
            result[going] = course.at(left)
            top = course.top(left)
            fires = course.at(top) >= self._threshold
            going = going[fires]
            if not going.size:
                break
            fired = begin[going] + course.of(fires).first_at(self._threshold, top[fires])
            self._fired.append((who[going], start + fired))
            begin[going] = fired + self._refractory
            self._free[who[going]] = start + begin[going]
            v[going] = result[going] = 0.0
            going = going[begin[going] < h]
        return result

    def spikes(self) -> list[Array]:
        """Return the times of the spikes so far, s, per receptor."""
        count = len(self._potential)
        if not self._fired:
            return [np.empty(0) for _ in range(count)]
        who, times = (np.concatenate(part) for part in zip(*self._fired, strict=True))
        order = np.argsort(who, kind="stable")
        return np.split(times[order], np.searchsorted(who[order], np.arange(1, count)))


class Course:
    """Potential under a linear current: v + (p - tau q - v)(1 - exp(-s/tau)) + q s.

    Parameters
    ----------
    v
        Potential at s = 0, mV, (n,).
    p, q
        R I at s = 0, mV, and its slope, mV/s, (n,).
    tau
        Time constant R C, s.
    """

    def __init__(self, v: Array, p: Array, q: Array, tau: float) -> None:
        self._v, self._q, self._tau = v, q, tau
        self._pull = p - tau * q - v  # positive: the course is concave, negative: convex

    def of(self, which: Array) -> Course:
        """Return the course of some."""
        v, q, pull = self._v[which], self._q[which], self._pull[which]
        return Course(v, pull + self._tau * q + v, q, self._tau)

    def at(self, s: Array) -> Array:
        """Return the potential, mV."""
        return self._v - self._pull * np.expm1(-s / self._tau) + self._q * s

    def top(self, s: Array) -> Array:
        """Return where in (0, s] the potential is highest, apart from its start."""
        turning = (self._pull > 0) & (self._q < 0)
        ratio = np.where(turning, self._pull, 1.0) / np.where(turning, -self._q * self._tau, 1.0)
        peak = self._tau * np.log(ratio)
        return np.where(turning & (peak > 0) & (peak < s), peak, s)

    def first_at(self, level: float, s: Array) -> Array:
        """Return where a level that is below at 0 and reached at `s` is first crossed.

        Newton's method from the end at which the tangent keeps to the crossing's side: from the
        left where the course is concave, from the right where it is convex.
        """
        x = np.where(self._pull > 0, 0.0, s)
        for _ in range(50):
            rate = self._pull / self._tau * np.exp(-x / self._tau) + self._q
            change = np.divide(level - self.at(x), rate, out=np.zeros_like(x), where=rate > 0)
            old, x = x, np.clip(x + change, 0.0, s)
            if np.all(np.abs(x - old) <= 1e-13 * s):
                break
        return x
