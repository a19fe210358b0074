"""Membrane: leaky integrate-and-fire neurons that are refractory, exact in time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.exponentials import ExponentialSum, root
from tactile_fem.neuron.segment import Segment
from tactile_fem.neuron.settings import Neuron
from tactile_fem.neuron.variability import Variability

Array = NDArray[Any]

# Spikes that follow one another faster would take for ever.
_SHORTEST_S = 1e-5


class Membrane:
    """Membranes of all receptors, advanced together from event to event.

    Proposed: the form of Hamasaki et al. (2020) as reconstructed, with numbers of our own::

        C dV/dt = -V/R + I;   V >= V_th + A: spike, then V = V_r for t_ref   (5)
        V_r = V_th (1 - exp(sigma xi)),   xi ~ N(0, 1) for each spike        (6)
        dA/dt = -A/tau_A;   each spike adds a to A                           (7)

    The noise, sigma, is in the reset: the distance V_th - V_r that a spike leaves to the next one
    is log-normal with median V_th (noisy reset: Gerstner 2000, DOI 10.1162/089976600300015899).
    V_th itself stays, so the same currents fire with and without noise. At a constant current the
    median interval is the one without noise; far above rheobase sigma is the standard deviation
    of the logarithm of the interval less t_ref. At rest V = 0, so the first spike has no noise.

    A, zero unless set, is the relative refractoriness: a threshold that each spike raises and that
    comes back exponentially (Kobayashi et al. 2009, DOI 10.3389/neuro.10.009.2009, one of their
    time scales). V - A obeys the equation of V with the current ``A (tau/tau_A - 1)/R`` besides
    and a threshold that stays, so it is as exact.

    A stretch takes a few products per receptor. Only where an upper bound of the current lets V
    come to the threshold is the first crossing looked for, to rounding. A negative current
    drives V below 0 without a floor.

    Parameters
    ----------
    neuron
        The constants; pF GOhm = ms, pA GOhm = mV.
    variability
        Factors of the distance from the reset to the threshold, anew for each spike.
    """

    def __init__(self, neuron: Neuron, variability: Variability) -> None:
        self._resistance = neuron.resistance_GOhm
        self._refractory = neuron.refractory_s
        self._tau = neuron.time_constant_s
        self._variability = variability
        self._threshold = neuron.threshold_mV
        self._jump, self._recovery = neuron.threshold_jump_mV, neuron.threshold_recovery_s
        self._raised = np.zeros(variability.count)  # A
        self._potential = np.zeros(variability.count)
        self._all = np.arange(variability.count)
        self._free = np.full(variability.count, -np.inf)  # end of refractoriness, s
        self._fired: list[tuple[Array, Array]] = []

    def advance(self, segment: Segment) -> None:
        """Advance through a stretch that follows the last one."""
        start, h, current, who = segment
        raised = self._raised[who]
        potential, seen = self._potential[who] - raised, self._seen(current, raised)
        # V cannot exceed what the current's upper bound would make of it if held throughout.
        drive = self._resistance * seen.bounds(h)[1]
        reach = drive + (potential - drive) * np.exp(-h / self._tau)
        event = (np.maximum(reach, potential) >= self._threshold) | (self._free[who] > start)
        raised = self._recovered(raised, h)
        end = Course(potential, seen, self._resistance, self._tau).at(h) + raised
        some = np.flatnonzero(event)
        if some.size:
            start, h = (np.broadcast_to(values, end.shape)[some] for values in (start, h))
            among = self._all[who][some]
            end[some], raised[some] = self._eventful(among, start, h, current.of(some))
        self._potential[who], self._raised[who] = end, raised

    def _recovered(self, raised: Array, s: Any) -> Array:
        """Return A a time `s` later."""
        return raised * np.exp(-s / self._recovery) if self._jump else raised

    def _seen(self, current: ExponentialSum, raised: Array) -> ExponentialSum:
        """Return the current that moves V - A."""
        if not self._jump:
            return current
        further = raised * (self._tau / self._recovery - 1) / self._resistance
        return replace(
            current,
            amplitudes=np.vstack([current.amplitudes, further]),
            times=np.append(current.times, self._recovery),
        )

    def _eventful(
        self, who: Array, start: Array, h: Array, current: ExponentialSum
    ) -> tuple[Array, Array]:
        """Return V and A at the end of a stretch in which `who` may fire or become free."""
        begin = np.minimum(np.maximum(self._free[who] - start, 0.0), h)
        v, last = self._potential[who], self._recovered(self._raised[who], h)
        raised = self._recovered(self._raised[who], begin)  # at `begin`
        result = v.copy()
        going = np.flatnonzero(begin < h)
        while going.size:
            left = h[going] - begin[going]
            now = self._seen(current.of(going).from_(begin[going]), raised[going])
            course = Course(v[going] - raised[going], now, self._resistance, self._tau)
            after, end = course.first_at(np.full_like(left, self._threshold), left)
            result[going] = end + self._recovered(raised[going], left)
            fires = np.isfinite(after)
            going = going[fires]
            fired = begin[going] + after[fires]
            firing, time = who[going], start[going] + fired
            if np.any(time - self._free[firing] + self._refractory < _SHORTEST_S):
                raise StudyError(
                    f"neuron: an afferent fires more than {1 / _SHORTEST_S:,.0f} times a second: "
                    "the gains are too high or refractory_s is too short"
                )
            self._fired.append((firing, time))
            jumped = self._recovered(raised[going], after[fires]) + self._jump
            last[going] = self._recovered(jumped, h[going] - fired)
            raised[going] = self._recovered(jumped, self._refractory)
            begin[going] = fired + self._refractory
            self._free[firing] = start[going] + begin[going]
            distance = self._threshold * self._variability.after_spike(firing)
            v[going] = result[going] = self._threshold - distance
            going = going[begin[going] < h[going]]
        return result, last

    def spikes(self) -> list[Array]:
        """Return the times of the spikes so far, s, per receptor."""
        count = len(self._potential)
        if not self._fired:
            return [np.empty(0) for _ in range(count)]
        who, times = (np.concatenate(part) for part in zip(*self._fired, strict=True))
        order = np.argsort(who, kind="stable")
        return np.split(times[order], np.searchsorted(who[order], np.arange(1, count)))


@dataclass(frozen=True)
class Course:
    """Potential V(s) that starts at `v` under a current: tau dV/ds = R I(s) - V.

    Parameters
    ----------
    v
        mV, (n,).
    current
        pA.
    resistance, tau
        R in GOhm; R C in s.
    """

    v: Array
    current: ExponentialSum
    resistance: float
    tau: float

    def of(self, which: Array) -> Course:
        """Return the course of some."""
        return replace(self, v=self.v[which], current=self.current.of(which))

    def at(self, s: Any) -> Array:
        """Return V, mV, at `s`, a number or (n,) or (m, n)."""
        current, tau = self.current, self.tau
        gone = -np.expm1(-s / tau)
        driven = current.constant * gone + current.slope * (s - tau * gone)
        for amplitude, time in zip(current.amplitudes, current.times, strict=True):
            # (exp(-s/slow) - exp(-s/fast)) / (1 - fast/slow): the same rounded rate twice keeps it
            # exact where the times are nearly equal.
            rate = abs(1 / tau - 1 / time)
            lag = -np.expm1(-rate * s) / (tau * rate) if rate else s / tau
            driven += amplitude * (np.exp(-s / max(tau, time)) * lag)
        return self.v * (1 - gone) + self.resistance * driven

    def first_at(self, level: Array, end: Array) -> tuple[Array, Array]:
        """Return where in [0, end] V first reaches `level`, infinity without, and V at the end.

        (V - level) exp(s/tau) rises where R I > level and falls elsewhere, so that between
        sign changes of R I - level one look at the ends tells.
        """
        last = self.at(end)
        low, high, below, above = np.zeros_like(end), end.copy(), self.v.copy(), last.copy()
        current = self.current
        excess = replace(current, constant=current.constant - level / self.resistance)
        least, most = excess.bounds(end)
        turns = np.flatnonzero((least < 0) & (most > 0))
        if turns.size:
            ends = end[turns]
            breaks = np.vstack([np.zeros_like(ends), excess.of(turns).zeros(ends), ends])
            potential = self.of(turns).at(breaks)
            row = (potential[1:] >= level[turns]).argmax(axis=0)
            column = np.arange(len(turns))
            low[turns], high[turns] = breaks[row, column], breaks[row + 1, column]
            below[turns], above[turns] = potential[row, column], potential[row + 1, column]
        result = np.where(self.v >= level, 0.0, np.inf)
        who = np.flatnonzero((above >= level) & (self.v < level))
        if who.size:
            mine, aim, low, high = self.of(who), level[who], low[who], high[who]
            below, above = below[who], above[who]
            result[who] = root(
                lambda s: mine.over(aim, s),
                low,
                high,
                rising=np.ones(len(who), dtype=bool),
                size=aim,
                start=low + (high - low) * (aim - below) / (above - below),
            )
        return result, last

    def over(self, level: Array, s: Array) -> tuple[Array, Array]:
        """Return V - level, mV, and dV/ds, mV/s."""
        v = self.at(s)
        return v - level, (self.resistance * self.current.at(s) - v) / self.tau
