"""The static part of transduction: what adapts and, of the paper, what is dynamic."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.currents import ExponentialSum, Segment
from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
Stretch = tuple[Any, Any, Any, Array, Array]
_PER_STRETCH = 8  # values of S in a stretch, for its mean


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


def _adapted(S: Array, h: Array, tau: float, start: Array) -> Array:
    """Return a of ``tau da/dt = S - a`` at the ends of stretches in which S is linear."""
    from scipy.linalg import solve_banded

    kept = np.exp(-h / tau)
    late = 1 + tau / h * np.expm1(-h / tau)  # weight of the later S
    added = late[:, None] * S[1:] + (1 - kept - late)[:, None] * S[:-1]
    bands = np.ones((2, len(S)))
    bands[1, :-1] = -kept
    return solve_banded((1, 0), bands, np.vstack([start, added]))
