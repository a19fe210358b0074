"""Membrane: leaky integrate-and-fire neurons with refractoriness, exact in time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.currents import ExponentialSum, Segment, root
from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
_SHORTEST_INTERVAL_S = 1e-5  # shorter intervals between spikes are an error of the input
# Keys of the streams.
_GAIN_STREAM, _DISTANCE_STREAM, _THRESHOLD_STREAM, _RESTING_STREAM = range(4)
_BLOCK_SIZE = 64  # numbers drawn at a time


class Membrane:
    """Membranes of all receptors, advanced together from event to event.

    Proposed: the form of Hamasaki et al. (2020) as reconstructed, with our own numbers::

        C dV/dt = -V/R + I;   V >= V_th + A: spike, then V = V_r for t_ref   (5)
        V_r = V_th (1 - exp(sigma xi)),   xi ~ N(0, 1) for each spike        (6)
        dA/dt = -A/tau_A;   each spike adds a to A                           (7)

    The noise, sigma, is in the reset: the distance V_th - V_r from a spike to the next one is
    log-normal with median V_th (noisy reset: Gerstner 2000, DOI 10.1162/089976600300015899).
    V_th is constant, so the same currents fire with and without noise. At a constant current the
    median interval is the one without noise; far above rheobase sigma is the standard deviation
    of the logarithm of the interval less t_ref. At rest V = 0, so the first spike has no noise.

    A, zero unless set, is the relative refractoriness: each spike raises the threshold, which
    recovers exponentially (Kobayashi et al. 2009, DOI 10.3389/neuro.10.009.2009, one of their
    time scales). V - A obeys the equation of V with a constant threshold and the additional
    current ``A (tau/tau_A - 1)/R``, so it is as exact.

    A stretch takes a few products per receptor. The first crossing is computed, to rounding, only
    where an upper bound of the current lets V reach the threshold. A negative current drives V
    below 0 without a floor.

    Units: pF GOhm = ms, pA GOhm = mV.
    """

    def __init__(self, neuron: Neuron, variability: Variability) -> None:
        count = variability.count
        self._neuron, self._variability = neuron, variability
        self._tau, self._resistance = neuron.time_constant_s, neuron.resistance_GOhm
        self._raised = np.zeros(count)  # A
        self._potential = np.zeros(count)
        self._all = np.arange(count)
        self._free_s = np.full(count, -np.inf)  # end of refractoriness
        self._fired: list[tuple[Array, Array]] = []

    def advance(self, segment: Segment) -> None:
        """Advance through a stretch that follows the last one."""
        start, h, current, who = segment
        raised = self._raised[who]
        potential, effective = self._potential[who] - raised, self._effective(current, raised)
        # V cannot exceed its value under a constant current at the upper bound.
        limit = self._resistance * effective.bounds(h)[1]
        reach = limit + (potential - limit) * np.exp(-h / self._tau)
        may_fire = np.maximum(reach, potential) >= self._neuron.threshold_mV
        raised = self._recovered(raised, h)
        end = Course(potential, effective, self._resistance, self._tau).at(h) + raised
        some = np.flatnonzero(may_fire | (self._free_s[who] > start))
        if some.size:
            start, h = (np.broadcast_to(values, end.shape)[some] for values in (start, h))
            end[some], raised[some] = self._with_events(
                self._all[who][some], start, h, current.of(some)
            )
        self._potential[who], self._raised[who] = end, raised

    def _recovered(self, raised: Array, s: Any) -> Array:
        """Return A a time `s` later."""
        jump, tau = self._neuron.threshold_jump_mV, self._neuron.threshold_recovery_s
        return raised * np.exp(-s / tau) if jump else raised

    def _effective(self, current: ExponentialSum, raised: Array) -> ExponentialSum:
        """Return the current that moves V - A."""
        if not self._neuron.threshold_jump_mV:
            return current
        recovery = self._neuron.threshold_recovery_s
        further = raised * (self._tau / recovery - 1) / self._resistance
        return replace(
            current,
            amplitudes=np.vstack([current.amplitudes, further]),
            times=np.append(current.times, recovery),
        )

    def _with_events(
        self, who: Array, start: Array, h: Array, current: ExponentialSum
    ) -> tuple[Array, Array]:
        """Return V and A at the end of a stretch in which `who` may fire or become free."""
        n = self._neuron
        begin = np.minimum(np.maximum(self._free_s[who] - start, 0.0), h)
        v, last = self._potential[who], self._recovered(self._raised[who], h)
        raised = self._recovered(self._raised[who], begin)  # at `begin`
        result = v.copy()
        going = np.flatnonzero(begin < h)
        while going.size:
            left = h[going] - begin[going]
            now = self._effective(current.of(going).from_(begin[going]), raised[going])
            course = Course(v[going] - raised[going], now, self._resistance, self._tau)
            after, end = course.first_at(np.full_like(left, n.threshold_mV), left)
            result[going] = end + self._recovered(raised[going], left)
            fires = np.isfinite(after)
            going = going[fires]
            fired = begin[going] + after[fires]
            firing, time = who[going], start[going] + fired
            if np.any(time - self._free_s[firing] + n.refractory_s < _SHORTEST_INTERVAL_S):
                raise StudyError(
                    f"neuron: an afferent fires more than {1 / _SHORTEST_INTERVAL_S:,.0f} times a "
                    "second: the gains are too high or refractory_s is too short"
                )
            self._fired.append((firing, time))
            jumped = self._recovered(raised[going], after[fires]) + n.threshold_jump_mV
            last[going] = self._recovered(jumped, h[going] - fired)
            raised[going] = self._recovered(jumped, n.refractory_s)
            begin[going] = fired + n.refractory_s
            self._free_s[firing] = start[going] + begin[going]
            distance = n.threshold_mV * self._variability.after_spike(firing)
            v[going] = result[going] = n.threshold_mV - distance
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
    """Potential V(s) under a current: tau dV/ds = R I(s) - V.

    `start_mV` is (n,), `current` in pA; `resistance` is R in GOhm, `tau` R C in s.
    """

    start_mV: Array
    current: ExponentialSum
    resistance: float
    tau: float

    def of(self, which: Array) -> Course:
        """Return some of the courses."""
        return replace(self, start_mV=self.start_mV[which], current=self.current.of(which))

    def at(self, s: Any) -> Array:
        """Return V, mV, at `s`, a number or (n,) or (m, n)."""
        current, tau = self.current, self.tau
        decayed = -np.expm1(-s / tau)
        driven = current.constant * decayed + current.slope * (s - tau * decayed)
        for amplitude, time in zip(current.amplitudes, current.times, strict=True):
            # (exp(-s/slow) - exp(-s/fast)) / (1 - fast/slow): the same rounded rate twice keeps it
            # exact where the times are nearly equal.
            rate = abs(1 / tau - 1 / time)
            lag = -np.expm1(-rate * s) / (tau * rate) if rate else s / tau
            driven += amplitude * (np.exp(-s / max(tau, time)) * lag)
        return self.start_mV * (1 - decayed) + self.resistance * driven

    def first_at(self, level: Array, end: Array) -> tuple[Array, Array]:
        """Return where in [0, end] V first reaches `level`, infinity without, and V at the end.

        (V - level) exp(s/tau) increases where R I > level and decreases elsewhere. Between sign
        changes of R I - level the values at the ends thus decide.
        """
        last = self.at(end)
        low, high, below, above = np.zeros_like(end), end.copy(), self.start_mV.copy(), last.copy()
        current = self.current
        excess = current.plus(-level / self.resistance)
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
        result = np.where(self.start_mV >= level, 0.0, np.inf)
        who = np.flatnonzero((above >= level) & (self.start_mV < level))
        if who.size:
            mine, aim, low, high = self.of(who), level[who], low[who], high[who]
            below, above = below[who], above[who]
            start = low + (high - low) * (aim - below) / (above - below)

            def excess_of(s: Array) -> tuple[Array, Array]:
                """Return V - level, mV, and dV/ds, mV/s."""
                v = mine.at(s)
                return v - aim, (self.resistance * mine.current.at(s) - v) / self.tau

            result[who] = root(excess_of, low, high, rising=True, size=aim, start=start)
        return result, last


class Variability:
    """What differs between afferents and spikes: currents at rest, and log-normal factors.

    The factors are those of gains, thresholds and distances from reset to threshold.

    Each afferent has its own stream of random numbers, which follows from the seed and the
    number of the afferent, `units` (n,): spikes do not depend on the other afferents.
    """

    def __init__(self, neuron: Neuron, units: NDArray[np.int64]) -> None:
        self._neuron, self._units = neuron, units
        self.count = len(units)
        self._used = np.zeros(self.count, dtype=np.int64)
        self._normal = np.zeros((self.count, _BLOCK_SIZE if neuron.threshold_noise else 0))

    def gains(self) -> Array:
        """Return the factor of the gains of each afferent, median 1, (n,)."""
        return np.exp(self._neuron.gain_spread * self._normals(_GAIN_STREAM))

    def thresholds(self) -> Array:
        """Return the factor of the threshold of each afferent, median 1, (n,)."""
        return np.exp(self._neuron.threshold_spread * self._normals(_THRESHOLD_STREAM))

    def resting_pA(self) -> Array:
        """Return the current of each afferent without a load, (n,)."""
        n = self._neuron
        return n.resting_pA + n.resting_spread_pA * self._normals(_RESTING_STREAM)

    def _normals(self, purpose: int) -> Array:
        return np.array([self._draw(purpose, unit, 0)[0] for unit in self._units.tolist()])

    def after_spike(self, which: Array) -> Array:
        """Return the next factors of the distances of some, median 1, without repetition."""
        if not self._neuron.threshold_noise:
            return np.ones(len(which))
        place = self._used[which] % _BLOCK_SIZE
        for k in which[place == 0].tolist():
            block = int(self._used[k]) // _BLOCK_SIZE
            self._normal[k] = self._draw(_DISTANCE_STREAM, int(self._units[k]), block)
        self._used[which] += 1
        return np.exp(self._neuron.threshold_noise * self._normal[which, place])

    def _draw(self, purpose: int, unit: int, block: int) -> Array:
        key = [self._neuron.seed, purpose]
        stream = np.random.Philox(key=key, counter=[0, 0, block, unit])
        return np.random.Generator(stream).standard_normal(_BLOCK_SIZE)
