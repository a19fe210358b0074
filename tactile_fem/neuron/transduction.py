"""Transduction: from the drive of an afferent to the current that enters its membrane."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.compressive import Logarithmic, Power
from tactile_fem.neuron.currents import ExponentialSum, Segment, Transduction
from tactile_fem.neuron.settings import Neuron
from tactile_fem.neuron.static import StaticDynamic, intercept_pA

Array = NDArray[Any]
# Values of the filter in a period of its centre frequency; lines between them err by up to 1.2 %.
_VALUES_PER_PERIOD = 20


class GeneratorFunction:
    """The generator function of Gerling et al. (2018), DOI 10.1371/journal.pcbi.1006264.

    Parts that inactivate at different speeds::

        I = I_0 + sum_i max(k_i e_i, 0),   de_i/dt = dS/dt - e_i/tau_i

    with I_0 while S > 0 as in `StaticDynamic` (zero unless set), times tau_i of 8, 200, 1745 ms
    and one part without inactivation, e = S. Theirs takes stress; S is any drive here. The part
    without inactivation is k S for a negative S too, and inhibits. S at the first sample counts
    as a step.
    """

    def __init__(self, neuron: Neuron) -> None:
        self._times = np.array(neuron.generator_times_s)
        *gains, self._lasting = neuron.generator_gains_pA_per_kPa
        self._gains = np.array(gains)[:, None]
        self._intercept = intercept_pA(neuron)

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current between samples, divided where a part changes its sign."""
        times = self._times[:, None]
        part = np.tile(drive[0], (len(times), 1))
        for k, h in enumerate(np.diff(time_s)):
            S, end = drive[k], drive[k + 1]
            slope = (end - S) / h
            limit = times * slope  # of a part
            away = part - limit
            line = self._lasting * S + self._intercept * (S + end > 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                zeros = times * np.log(-away / limit)
            zeros = np.sort(np.where((zeros > 0) & (zeros < h), zeros, h), axis=0)
            for begin, until in pairwise([0 * slope, *zeros, 0 * slope + h]):
                who = np.flatnonzero(until > begin)
                if not who.size:
                    continue
                gains = self._gains * (limit + away * np.exp(-0.5 * (begin + until) / times) > 0)
                current = ExponentialSum(
                    line + (gains * limit).sum(axis=0),
                    self._lasting * slope,
                    gains * away,
                    self._times,
                )
                start, length = begin[who], (until - begin)[who]
                yield Segment(time_s[k] + start, length, current.of(who).from_(start), who)
            part = limit + away * np.exp(-h / times)


class BandPass:
    """Rectified band-pass of the drive, for RA and PC afferents.

    Proposed: with `D` the drive, each of `order` equal stages a pair of complex poles::

        H(s) = [ (w_0/Q) s / (s^2 + (w_0/Q) s + w_0^2) ]^order,   w_0 = 2 pi f_0
        y = H D,      I = g ( [y]_+ + off [-y]_+ )

    Below the centre frequency `y` is like the drive's rate with one stage and like its
    acceleration with two, which are the slopes of measured thresholds of RA and PC; at it, `y` is
    the drive. Changes in the other direction count by the share `off`.

    The drive is linear between its samples and `y` is then exact. The current is linear between
    twenty values in each period of the centre frequency. Before the first sample the drive has
    always been constant.
    """

    def __init__(self, neuron: Neuron) -> None:
        self._gain, self._off = neuron.filter_gain_pA, neuron.filter_off
        self._longest_s = 1 / (_VALUES_PER_PERIOD * neuron.filter_centre_Hz)
        w = 2 * np.pi * neuron.filter_centre_Hz
        b = w / neuron.filter_quality
        # Each stage: x' = v, v' = in - b v - w^2 x, out = b v.
        count = 2 * neuron.filter_order
        A, B = np.zeros((count, count)), np.zeros(count)
        for stage in range(0, count, 2):
            A[stage, stage + 1] = 1.0
            A[stage + 1, stage : stage + 2] = -(w**2), -b
            if stage:
                A[stage + 1, stage - 1] = b
        B[1] = 1.0
        self._A, self._B, self._b = A, B, b

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current between the values of the filter."""
        state = np.linalg.solve(-self._A, self._B[:, None] * drive[0])
        current = self._current(state)
        step_of = cache(self._step)
        no_exponentials = np.zeros((0, drive.shape[1])), np.zeros(0)
        for k, h in enumerate(np.diff(time_s)):
            count = int(np.ceil(h / self._longest_s))
            dt = float(h) / count
            slope = (drive[k + 1] - drive[k]) / h
            # To ten digits, so that equal steps share their matrices.
            of_state, of_drive, of_slope = step_of(float(f"{dt:.10g}"))
            for j in range(count):
                state = of_state @ state + np.outer(of_drive, drive[k] + j * dt * slope)
                state += np.outer(of_slope, slope)
                later = self._current(state)
                line = ExponentialSum(current, (later - current) / dt, *no_exponentials)
                yield Segment(time_s[k] + j * dt, dt, line)
                current = later

    def _step(self, dt: float) -> tuple[Array, Array, Array]:
        """Return the matrix of the state over a step, and vectors of drive and slope."""
        from scipy.linalg import expm

        n = len(self._B)
        whole = np.zeros((n + 2, n + 2))
        whole[:n, :n], whole[:n, n], whole[n, n + 1] = self._A, self._B, 1.0
        found = expm(whole * dt)
        return found[:n, :n], found[:n, n], found[:n, n + 1]

    def _current(self, state: Array) -> Array:
        y = self._b * state[-1]
        return self._gain * (np.maximum(y, 0.0) + self._off * np.maximum(-y, 0.0))


@dataclass(frozen=True, eq=False)
class Adaptation:
    """Transduction of afferents that have met the first value of a history for `held_s` before.

    Their membranes are at rest when the history begins.
    """

    own: Transduction
    held_s: float

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current of the history, without that of the time before."""
        time = np.append(time_s[0] - self.held_s, time_s)
        for segment in self.own.segments(time, np.vstack([drive[:1], drive])):
            if np.min(segment.start_s) >= time_s[0]:
                yield segment


@dataclass(frozen=True, eq=False)
class Accustomed:
    """Transduction of afferents that have met the like of a history for `contact_s` before."""

    own: StaticDynamic
    contact_s: float

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current; adaptations begin near the mean of the history."""
        return self.own.segments(time_s, drive, self.contact_s)


def accustomed(own: Transduction, contact_s: float) -> Transduction:
    """Return a transduction after a contact; a band-pass is the same.

    StudyError for one whose adaptation is not known here.
    """
    if isinstance(own, BandPass):
        return own
    if not isinstance(own, StaticDynamic):
        raise StudyError(f"How {type(own).__name__} adapts to a contact is not known.")
    return Accustomed(own, contact_s)


def held(own: Transduction, held_s: float) -> Transduction:
    """Return a transduction adapted to the first value; a band-pass has always met it."""
    return own if isinstance(own, BandPass) else Adaptation(own, held_s)


@dataclass(frozen=True, eq=False)
class Varied:
    """Transduction of afferents with thresholds higher by factors, and currents at rest, (n,).

    Potentials are relative to the threshold: a higher one is a smaller current.
    """

    own: Transduction
    thresholds: Array
    resting_pA: Array

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the currents, relative to the thresholds."""
        for segment in self.own.segments(time_s, drive):
            current = segment.current_pA.plus(self.resting_pA[segment.who])
            yield segment._replace(current_pA=current.scaled(1 / self.thresholds[segment.who]))


_MODELS: dict[str, Callable[[Neuron], Transduction]] = {
    "hamasaki2020": StaticDynamic,
    "gerling2018": GeneratorFunction,
    "power": Power,
    "logarithmic": Logarithmic,
    "band_pass": BandPass,
}


def transduction_of(neuron: Neuron) -> Transduction:
    """Return the model that the study names."""
    return _MODELS[neuron.model](neuron)
