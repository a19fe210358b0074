"""Transduction: from the drive of an afferent to the current that enters its membrane."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.currents import ExponentialSum, Segment, Transduction
from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
Stretch = tuple[Any, Any, Any, Array, Array]
# Largest distance of a compressed drive from the chords that replace it, in units of S,
# for a logarithm of S_0.
CHORD_ERROR = 0.002
_PER_STRETCH = 8  # values of S in a stretch, for its mean
# Values of the filter in a period of its centre frequency; lines between them err by up to 1.2 %.
_VALUES_PER_PERIOD = 20


def intercept_pA(neuron: Neuron) -> float:
    """Return I_0: as set; else the rheobase V_th/R, mV/GOhm = pA, of "hamasaki2020", or 0."""
    if neuron.intercept_pA is not None:
        return neuron.intercept_pA
    return neuron.threshold_mV / neuron.resistance_GOhm if neuron.model == "hamasaki2020" else 0.0


class StaticDynamic:
    """Static part with exponential decay, dynamic part and intercept.

    Proposed: the form of Hamasaki et al. (2020) as reconstructed, with our own numbers::

        I = I_s + I_d + I_0                                       (2)
        I_s = alpha (S - kappa a),   tau_a da/dt = S - a          (3)
        I_d = beta max(dS/dt, 0)                                  (4)

    S is the drive. The intercept I_0 acts only while S > 0, so that a finger at rest is silent:
    where S leaves or reaches zero, for the whole stretch between the two samples; where S changes
    its sign, if its mean there is positive. The adaptation starts at a = 0. S is linear between
    the samples, so the current is a line and an exponential, and jumps with dS/dt. After a contact
    of some length with the like of the history, the adaptation starts near the mean of S.

    A negative S gives a negative static current, which inhibits; when S returns to zero, the
    adaptation makes the current rebound. I_d responds to any increase.

    Shares kappa_j and times tau_j, s, of `further` adaptations add - alpha kappa_j a_j.
    """

    def __init__(self, neuron: Neuron, further: Sequence[tuple[float, float]] = ()) -> None:
        self._neuron = neuron
        adapting = [(neuron.adaptation, neuron.adaptation_time_s), *further]
        shares, times = np.array([pair for pair in adapting if pair[0]]).reshape(-1, 2).T
        self._gains, self._times = neuron.static_gain_pA_per_kPa * shares[:, None], times

    def segments(self, time_s: Array, drive: Array, contact_s: float = 0.0) -> Iterator[Segment]:
        """Yield the current of each stretch in which S is linear."""
        n, gains, times = self._neuron, self._gains, self._times[:, None]
        lasting = n.static_gain_pA_per_kPa - gains.sum()
        intercept = intercept_pA(n)
        lag = self._met(time_s, drive, contact_s, times) - self._compressed(drive[0])  # a - S
        for who, start, h, S, end in self._stretches(time_s, drive):
            slope = (end - S) / h
            behind = times * slope
            away = lag[:, who] + behind  # of a from its steady course, which is behind S
            constant = lasting * S + (gains * behind).sum(axis=0)
            constant += n.dynamic_gain_pA_s_per_kPa * np.maximum(slope, 0.0)
            constant += intercept * (S + end > 0)
            current = ExponentialSum(constant, lasting * slope, -gains * away, self._times)
            yield Segment(start, h, current, who)
            lag[:, who] = away * np.exp(-h / times) - behind

    def current_at(self, at_s: Array, time_s: Array, drive: Array, contact_s: float = 0.0) -> Array:
        """Return the current at increasing times within a history, (times, receptors).

        S is linear between these times and the samples; at a jump the current is the later one.
        """
        n, knots = self._neuron, np.union1d(time_s, at_s)
        S = self._compressed(np.column_stack([np.interp(knots, time_s, one) for one in drive.T]))
        h = np.diff(knots)
        slope = np.diff(S, axis=0) / h[:, None]
        slope = np.concatenate([slope, slope[-1:]])
        current = n.static_gain_pA_per_kPa * S + n.dynamic_gain_pA_s_per_kPa * np.maximum(slope, 0)
        current += intercept_pA(n) * (S + np.concatenate([S[1:], S[-1:]]) > 0)
        met = self._met(time_s, drive, contact_s, self._times[:, None])
        for gain, tau, start in zip(self._gains[:, 0], self._times, met, strict=True):
            current -= gain * _adapted(S, h, tau, start)
        return current[np.searchsorted(knots, at_s)]

    def _met(self, time_s: Array, drive: Array, contact_s: float, times: Array) -> Array:
        """Return a after a contact in which S had its mean of the history, (times, receptors)."""
        if not contact_s:
            return np.zeros((len(times), drive.shape[1]))
        h, shares = np.diff(time_s)[:, None], (np.arange(_PER_STRETCH) + 0.5) / _PER_STRETCH
        inside = (drive[:-1] + share * np.diff(drive, axis=0) for share in shares)
        S = np.mean([self._compressed(values) for values in inside], axis=0)
        return -np.expm1(-contact_s / times) * (h * S).sum(axis=0) / h.sum()

    def _compressed(self, drive: Array) -> Array:
        """Return S of a drive."""
        return drive

    def _stretches(self, time_s: Array, drive: Array) -> Iterator[Stretch]:
        """Yield receptors, start, length, and S at both ends, of stretches where S is linear."""
        S = self._compressed(drive)
        for k, h in enumerate(np.diff(time_s)):
            yield slice(None), time_s[k], h, S[k], S[k + 1]


def rectified(segment: Segment) -> Iterator[Segment]:
    """Yield a segment in parts, with zero in place of negative currents."""
    start, length, current, who = segment
    low, _ = current.bounds(length)
    if (low >= 0).all():
        yield segment
        return
    start, h = (np.broadcast_to(values, low.shape) for values in (start, length))
    numbers = np.arange(len(low)) if isinstance(who, slice) else who
    for begin, until in pairwise([np.zeros_like(h), *current.zeros(h), h]):
        (some,) = np.nonzero(until > begin)
        if some.size:
            part = current.of(some).from_(begin[some])
            left = (until - begin)[some]
            signed = part.scaled((part.at(0.5 * left) > 0).astype(float))
            yield Segment((start + begin)[some], left, signed, numbers[some])


def _adapted(S: Array, h: Array, tau: float, start: Array) -> Array:
    """Return a of ``tau da/dt = S - a`` at the ends of stretches in which S is linear."""
    from scipy.linalg import solve_banded

    kept = np.exp(-h / tau)
    late = 1 + tau / h * np.expm1(-h / tau)  # weight of the later S
    added = late[:, None] * S[1:] + (1 - kept - late)[:, None] * S[:-1]
    bands = np.ones((2, len(S)))
    bands[1, :-1] = -kept
    return solve_banded((1, 0), bands, np.vstack([start, added]))


class Compressive(StaticDynamic):
    """Static part of a compressed drive, with a second, fast adaptation.

    The drive is linear between the samples, the compressed one is not: a stretch is divided, for
    each receptor separately, into equal increments of a measure of the drive, so short that chords
    are off by at most 0.002 units of S.
    """

    def __init__(self, neuron: Neuron, chord: float) -> None:
        """Take the distance of a chord of S, in its units, over an increment of 1."""
        super().__init__(neuron, [(neuron.fast_adaptation, neuron.fast_adaptation_time_s)])
        self._longest = float(np.sqrt(CHORD_ERROR / chord))

    def _measure(self, drive: Array) -> Array:
        """Return the measure of a drive, of which equal increments have chords equally far off."""
        raise NotImplementedError

    def _drive(self, measure: Array) -> Array:
        """Return the drive of a measure."""
        raise NotImplementedError

    def _of_measure(self, measure: Array) -> Array:
        """Return S of a measure."""
        raise NotImplementedError

    def _compressed(self, drive: Array) -> Array:
        return self._of_measure(self._measure(drive))

    def _stretches(self, time_s: Array, drive: Array) -> Iterator[Stretch]:
        """Divide stretches into equal increments of the measure."""
        measure = self._measure(drive)
        for k, h in enumerate(np.diff(time_s)):
            start, away = measure[k], measure[k + 1] - measure[k]
            chords = np.maximum(np.abs(away) / self._longest, 1.0)
            if chords.max(initial=1.0) == 1.0:
                ends = self._of_measure(measure[k : k + 2])
                yield slice(None), time_s[k], h, *ends
                continue
            parts = 2 ** np.ceil(np.log2(chords)).astype(int)
            for count in np.unique(parts):
                mine = np.flatnonzero(parts == count)
                share = np.arange(count + 1)[:, None] / count
                levels = start[mine] + share * away[mine]
                risen = self._drive(levels) - self._drive(start[mine])
                at, S = h * (risen / risen[-1] if count > 1 else share), self._of_measure(levels)
                for j in range(count):
                    yield mine, time_s[k] + at[j], at[j + 1] - at[j], S[j], S[j + 1]


class Power(Compressive):
    """A power of the drive above a threshold.

    Proposed: with the power fitted to the rates of monkeys' afferents, as Stevens's law has one for
    what people feel::

        S = max(D - D_0, 0)^p

    for a drive D in its unit, such as kPa, of which S is taken to be as well. Where D is below the
    threshold D_0, it evokes nothing. A current that adaptation would make negative is zero:
    channels that close do not hyperpolarize the membrane. The measure is the square root of S, of
    which increments x have chords that are off by (1/p - 1)/2 x^2, and by x^2/4 at the threshold.
    """

    def __init__(self, neuron: Neuron) -> None:
        super().__init__(neuron, max(0.25, abs(1 / neuron.power - 1) / 2))
        self._threshold, self._half = neuron.drive_threshold_kPa, neuron.power / 2

    def segments(self, time_s: Array, drive: Array, contact_s: float = 0.0) -> Iterator[Segment]:
        """Yield the current, divided where it reaches or leaves zero."""
        for segment in super().segments(time_s, drive, contact_s):
            yield from rectified(segment)

    def current_at(self, at_s: Array, time_s: Array, drive: Array, contact_s: float = 0.0) -> Array:
        """Return the current, which is never negative."""
        return np.maximum(super().current_at(at_s, time_s, drive, contact_s), 0.0)

    def _measure(self, drive: Array) -> Array:
        above = drive - self._threshold
        return np.sign(above) * np.abs(above) ** self._half

    def _drive(self, measure: Array) -> Array:
        return self._threshold + np.sign(measure) * np.abs(measure) ** (1 / self._half)

    def _of_measure(self, measure: Array) -> Array:
        return np.maximum(measure, 0.0) ** 2


class Logarithmic(Compressive):
    """A logarithm of the drive.

    Proposed: currents grow with the logarithm of strain energy density, as the compressive stage
    of Loomis's tactile letters (1990) suggests::

        S = S_0 ln(1 + D/S_0)

    for a drive D, and -S(-D) where D is negative. S is D where D is much less than S_0. The measure
    is S/S_0, of which increments x have chords that are off by x^2/8 S_0.
    """

    def __init__(self, neuron: Neuron) -> None:
        super().__init__(neuron, 1 / 8)
        self._scale = neuron.compression_kPa

    def _measure(self, drive: Array) -> Array:
        return np.sign(drive) * np.log1p(np.abs(drive) / self._scale)

    def _drive(self, measure: Array) -> Array:
        return np.sign(measure) * self._scale * np.expm1(np.abs(measure))

    def _of_measure(self, measure: Array) -> Array:
        return self._scale * measure


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
    """Return a transduction after a contact; one without slow adaptations is not changed."""
    return Accustomed(own, contact_s) if isinstance(own, StaticDynamic) else own


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
