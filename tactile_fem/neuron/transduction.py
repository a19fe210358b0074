"""Transduction: from strain energy density to the current that enters the membrane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_fem.study import Neuron

Array = NDArray[Any]
VALUES_PER_PIECE = 500_000  # fine steps times receptors held at once


class Piece(NamedTuple):
    """Consecutive fine steps; within each the current is linear.

    Attributes
    ----------
    start_s, step_s
        Begin and length of the steps, s, (n,).
    first_pA, last_pA
        Current at the begin and the end of the steps, pA, (n, receptors). They differ from step
        to step where the current jumps: at samples.
    """

    start_s: Array
    step_s: Array
    first_pA: Array
    last_pA: Array


class Transduction:
    """Current of piecewise-linear histories.

    Static, dynamic part and intercept, proposed: the form of Hamasaki et al. (2020) as
    reconstructed, with numbers of our own::

        I = I_s + I_d + I_0                                       (2)
        I_s = alpha (S - kappa a),   tau_a da/dt = S - a          (3)
        I_d = beta max(dS/dt, 0)                                  (4)

    with the intercept I_0 (the rheobase V_th/R unless set) only while S > 0, exactly: a finger
    at rest is silent. Where S leaves or reaches zero, I_0 belongs to the whole segment between
    the two samples. The adaptation starts at a = 0.

    Every segment is cut evenly into steps no longer than `Neuron.dt_s`, so that no step spans a
    sample.

    Parameters
    ----------
    time_s
        Increasing times of the samples, s, (t,).
    sed_kPa
        S >= 0, kPa, (t, receptors).
    neuron
        The constants.
    """

    def __init__(self, time_s: Array, sed_kPa: Array, neuron: Neuron) -> None:
        self._neuron = neuron
        self._time, self._sed = time_s, sed_kPa
        length = np.diff(time_s)
        steps = np.maximum(np.ceil(length / neuron.dt_s - 1e-9), 1).astype(np.int64)
        self._step = length / steps
        self._offset = np.concatenate([[0], np.cumsum(steps)])
        self._adaptation = self._at_samples(length)

    def _at_samples(self, length: Array) -> Array:
        a = np.zeros_like(self._sed)
        for k, h in enumerate(length):
            a[k + 1] = self._relaxed(self._sed[k], (self._sed[k + 1] - self._sed[k]) / h, a[k], h)
        return a

    def _relaxed(self, sed: Array, slope: Array, a: Array, after_s: Any) -> Array:
        """Return a of equation (3), exactly, `after_s` into a segment that starts with `a`."""
        tau = self._neuron.adaptation_time_s
        gone = -np.expm1(-after_s / tau)
        return a + (sed - a) * gone + slope * (after_s - tau * gone)

    def pieces(self) -> Iterator[Piece]:
        """Yield the current of all fine steps in order, a bounded number at a time."""
        size = max(1, VALUES_PER_PIECE // max(1, self._sed.shape[1]))
        for begin in range(0, int(self._offset[-1]), size):
            step = np.arange(begin, min(begin + size, self._offset[-1]))
            segment = np.searchsorted(self._offset, step, side="right") - 1
            h = self._step[segment]
            after = (step - self._offset[segment]) * h
            first, last = self._current(segment, after, after + h)
            yield Piece(self._time[segment] + after, h, first, last)

    def _current(self, segment: Array, *after_s: Array) -> list[Array]:
        n = self._neuron
        sed, end, a = self._sed[segment], self._sed[segment + 1], self._adaptation[segment]
        slope = (end - sed) / (self._time[segment + 1] - self._time[segment])[:, None]
        constant = np.where(sed + end > 0, intercept_pA(n), 0.0)
        constant += n.dynamic_gain_pA_s_per_kPa * np.maximum(slope, 0.0)
        currents = []
        for after in after_s:
            s = after[:, None]
            adapted = n.adaptation * self._relaxed(sed, slope, a, s)
            currents.append(constant + n.static_gain_pA_per_kPa * (sed + slope * s - adapted))
        return currents


def intercept_pA(neuron: Neuron) -> float:
    """Return I_0: as set, or the rheobase V_th/R, mV/GOhm = pA."""
    if neuron.intercept_pA is None:
        return neuron.threshold_mV / neuron.resistance_GOhm
    return neuron.intercept_pA
