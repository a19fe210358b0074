"""Transduction: from what is felt to the current that enters the membrane."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.exponentials import ExponentialSum
from tactile_fem.study import Neuron

Array = NDArray[Any]


class Segment(NamedTuple):
    """A stretch of time with one expression for the current.

    Attributes
    ----------
    start_s, length_s
        Begin and length, s: numbers, or (n,) where the stretches differ.
    current_pA
        The current over the time since the begin, pA.
    who
        Which receptors; all have come to the begin.
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


def transduction_of(neuron: Neuron) -> Transduction:
    """Return the model that the study names."""
    return GeneratorFunction(neuron) if neuron.model == "gerling2018" else StaticDynamic(neuron)


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
    """

    def __init__(self, neuron: Neuron) -> None:
        self._neuron = neuron

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current of each stretch between two samples."""
        n = self._neuron
        static, dynamic = n.static_gain_pA_per_kPa, n.dynamic_gain_pA_s_per_kPa
        tau, adapting = n.adaptation_time_s, static * n.adaptation
        lasting, times = static - adapting, np.array([tau])
        rest = intercept_pA(n)
        lag = -drive[0]  # a - S
        for k, h in enumerate(np.diff(time_s)):
            felt, end = drive[k], drive[k + 1]
            slope = (end - felt) / h
            behind = tau * slope
            away = lag + behind  # of a from where it follows S
            constant = lasting * felt + adapting * behind + dynamic * np.maximum(slope, 0.0)
            constant += rest * (felt + end > 0)
            current = ExponentialSum(constant, lasting * slope, -adapting * away[None], times)
            yield Segment(time_s[k], h, current)
            lag = away * np.exp(-h / tau) - behind


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
    """Return I_0: as set; else the rheobase V_th/R, mV/GOhm = pA, or 0 of "gerling2018"."""
    if neuron.intercept_pA is not None:
        return neuron.intercept_pA
    return 0.0 if neuron.model == "gerling2018" else neuron.threshold_mV / neuron.resistance_GOhm
