"""Transduction: from what is felt to the current that enters the membrane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.band_pass import BandPass
from tactile_fem.neuron.exponentials import ExponentialSum
from tactile_fem.neuron.segment import Segment, Transduction
from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
_CHORD = 0.002  # how far a logarithm may be from straight lines, as a share of its scale


def transduction_of(neuron: Neuron) -> Transduction:
    """Return the model that the study names."""
    match neuron.model:
        case "hamasaki2020":
            return StaticDynamic(neuron)
        case "gerling2018":
            return GeneratorFunction(neuron)
        case "logarithmic":
            return Logarithmic(neuron)
        case "band_pass":
            return BandPass(neuron)


class StaticDynamic:
    """Static part with exponential decay, dynamic part and intercept.

    Proposed: the form of Hamasaki et al. (2020) as reconstructed, with numbers of our own::

        I = I_s + I_d + I_0                                       (2)
        I_s = alpha (S - kappa a),   tau_a da/dt = S - a          (3)
        I_d = beta max(dS/dt, 0)                                  (4)

    with the intercept I_0 only while S > 0, exactly: a finger at rest is silent. Where S leaves
    or reaches zero, I_0 belongs to the whole stretch between the two samples; where S changes its
    sign, if its mean there is positive. The adaptation starts at a = 0. S is linear between the
    samples; the current is then a line and one exponential, and jumps with dS/dt.

    S is the drive, whatever it is. A negative S gives a negative static current, which inhibits;
    when S returns to zero, the adaptation makes the current rebound. I_d answers to any rise.

    Parameters
    ----------
    neuron
        The constants.
    further
        Shares kappa_j and times tau_j, s, of further adaptations, which add - alpha kappa_j a_j.
    """

    def __init__(self, neuron: Neuron, further: Sequence[tuple[float, float]] = ()) -> None:
        self._neuron = neuron
        adapting = [(neuron.adaptation, neuron.adaptation_time_s), *further]
        shares, times = np.array([pair for pair in adapting if pair[0]]).reshape(-1, 2).T
        self._gains, self._times = neuron.static_gain_pA_per_kPa * shares[:, None], times

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current of each stretch in which S is linear."""
        n, gains, times = self._neuron, self._gains, self._times[:, None]
        dynamic = n.dynamic_gain_pA_s_per_kPa
        lasting = n.static_gain_pA_per_kPa - gains.sum()
        rest = intercept_pA(n)
        lag = np.tile(-self._felt(drive[0]), (len(times), 1))  # a - S
        for who, start, h, felt, end in self._stretches(time_s, drive):
            slope = (end - felt) / h
            behind = times * slope
            away = lag[:, who] + behind  # of a from where it follows S
            constant = lasting * felt + (gains * behind).sum(axis=0)
            constant += dynamic * np.maximum(slope, 0.0) + rest * (felt + end > 0)
            current = ExponentialSum(constant, lasting * slope, -gains * away, self._times)
            yield Segment(start, h, current, who)
            lag[:, who] = away * np.exp(-h / times) - behind

    def _felt(self, drive: Array) -> Array:
        """Return S of a drive."""
        return drive

    def _stretches(
        self, time_s: Array, drive: Array
    ) -> Iterator[tuple[Any, Any, Any, Array, Array]]:
        """Yield who feels it, begin, length, S at begin and end of stretches where S is linear."""
        felt = self._felt(drive)
        for k, h in enumerate(np.diff(time_s)):
            yield slice(None), time_s[k], h, felt[k], felt[k + 1]


class Logarithmic(StaticDynamic):
    """The same of a logarithm of the drive, with a second, fast adaptation.

    Proposed: currents grow with the logarithm of strain energy density, as the compressive stage
    of Loomis's tactile letters (1990) and the rates under spheres (Goodwin et al. 1995) ask for::

        S = S_0 ln(1 + D/S_0)

    of the drive D, and -S(-D) where D is negative. S is D where D is much less than S_0.

    D is linear between the samples, S is not: a stretch is divided, for each receptor on its own,
    until S, linear in each part, is off by at most 0.002 S_0.

    Parameters
    ----------
    neuron
        The constants.
    """

    def __init__(self, neuron: Neuron) -> None:
        super().__init__(neuron, [(neuron.fast_adaptation, neuron.fast_adaptation_time_s)])
        self._scale = neuron.compression_kPa

    def _felt(self, drive: Array) -> Array:
        return np.sign(drive) * self._scale * np.log1p(np.abs(drive) / self._scale)

    def _drive(self, felt: Array) -> Array:
        return np.sign(felt) * self._scale * np.expm1(np.abs(felt) / self._scale)

    def _stretches(
        self, time_s: Array, drive: Array
    ) -> Iterator[tuple[Any, Any, Any, Array, Array]]:
        """Cut stretches where S rises by equal parts; a chord over x S_0 is off by x^2/8 S_0."""
        longest = np.sqrt(8 * _CHORD) * self._scale
        for who, start, h, felt, end in super()._stretches(time_s, drive):
            rises = np.abs(end - felt) / longest
            if rises.max(initial=0.0) <= 1.0:
                yield who, start, h, felt, end
                continue
            parts = 2 ** np.ceil(np.log2(np.maximum(rises, 1.0))).astype(int)
            for count in np.unique(parts):
                mine = np.flatnonzero(parts == count)
                share = np.arange(count + 1)[:, None] / count
                levels = felt[mine] + share * (end - felt)[mine]
                way = self._drive(levels) - self._drive(felt[mine])
                at = h * (way / way[-1] if count > 1 else share)
                for j in range(count):
                    yield mine, start + at[j], at[j + 1] - at[j], levels[j], levels[j + 1]


class GeneratorFunction:
    """The generator function of Gerling et al. (2018), DOI 10.1371/journal.pcbi.1006264.

    Parts that inactivate at different speeds::

        I = I_0 + sum_i max(k_i e_i, 0),   de_i/dt = dS/dt - e_i/tau_i

    with I_0 while S > 0 as in `StaticDynamic` (zero unless set), times tau_i of 8, 200, 1745 ms
    and one without inactivation, e = S. Theirs takes stress; S is any drive here. The part
    without inactivation is k S where S is negative too, and inhibits. All S at the first sample
    counts as a step.

    Parameters
    ----------
    neuron
        The constants.
    """

    def __init__(self, neuron: Neuron) -> None:
        self._times = np.array(neuron.generator_times_s)
        *gains, self._lasting = neuron.generator_gains_pA_per_kPa
        self._gains = np.array(gains)[:, None]
        self._rest = intercept_pA(neuron)

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current between samples, cut where a part changes its sign."""
        times = self._times[:, None]
        part = np.tile(drive[0], (len(times), 1))
        for k, h in enumerate(np.diff(time_s)):
            felt, end = drive[k], drive[k + 1]
            slope = (end - felt) / h
            level = times * slope  # where a part tends to
            away = part - level
            line = self._lasting * felt + self._rest * (felt + end > 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                zeros = times * np.log(-away / level)
            zeros = np.sort(np.where((zeros > 0) & (zeros < h), zeros, h), axis=0)
            for begin, until in pairwise([0 * slope, *zeros, 0 * slope + h]):
                who = np.flatnonzero(until > begin)
                if not who.size:
                    continue
                gains = self._gains * (level + away * np.exp(-0.5 * (begin + until) / times) > 0)
                current = ExponentialSum(
                    line + (gains * level).sum(axis=0),
                    self._lasting * slope,
                    gains * away,
                    self._times,
                )
                start, length = begin[who], (until - begin)[who]
                yield Segment(time_s[k] + start, length, current.of(who).from_(start), who)
            part = level + away * np.exp(-h / times)


def intercept_pA(neuron: Neuron) -> float:
    """Return I_0: as set; else the rheobase V_th/R, mV/GOhm = pA, of "hamasaki2020", or 0."""
    if neuron.intercept_pA is not None:
        return neuron.intercept_pA
    return neuron.threshold_mV / neuron.resistance_GOhm if neuron.model == "hamasaki2020" else 0.0
