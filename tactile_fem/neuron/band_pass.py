"""Transduction of afferents that answer to change: a band-pass filter, rectified."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from tactile_fem.neuron.exponentials import ExponentialSum
from tactile_fem.neuron.segment import Segment
from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
# Of the period of the centre frequency: straight lines are then off by at most 1.2 % there.
_SAMPLES = 20


class BandPass:
    """Rectified band-pass of the drive, for RA and PC afferents.

    Proposed: with `D` the drive, each of `order` equal stages a pair of complex poles::

        H(s) = [ (w_0/Q) s / (s^2 + (w_0/Q) s + w_0^2) ]^order,   w_0 = 2 pi f_0
        y = H D,      I = g ( [y]_+ + off [-y]_+ )

    Below the centre frequency `y` is like the drive's rate with one stage and like its
    acceleration with two, which are the slopes of measured thresholds of RA and PC; at it, `y` is
    the drive. What changes in the other direction counts by the share `off`.

    The drive is linear between its samples and `y` is then exact. The current is linear between
    twenty values in each period of the centre frequency. What was felt at the first sample has
    been felt for ever.

    Parameters
    ----------
    neuron
        The constants.
    """

    def __init__(self, neuron: Neuron) -> None:
        self._gain, self._off = neuron.filter_gain_pA, neuron.filter_off
        self._longest_s = 1 / (_SAMPLES * neuron.filter_centre_Hz)
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
        none = np.zeros((0, drive.shape[1])), np.zeros(0)
        for k, h in enumerate(np.diff(time_s)):
            count = int(np.ceil(h / self._longest_s))
            dt = float(h) / count
            slope = (drive[k + 1] - drive[k]) / h
            # To ten digits, so that equal steps share their matrices.
            own, value, rate = step_of(float(f"{dt:.10g}"))
            for j in range(count):
                state = own @ state + np.outer(value, drive[k] + j * dt * slope)
                state += np.outer(rate, slope)
                later = self._current(state)
                line = ExponentialSum(current, (later - current) / dt, *none)
                yield Segment(time_s[k] + j * dt, dt, line)
                current = later

    def _step(self, dt: float) -> tuple[Array, Array, Array]:
        """Return what the state takes over a step of itself, of the drive and of its slope."""
        n = len(self._B)
        whole = np.zeros((n + 2, n + 2))
        whole[:n, :n], whole[:n, n], whole[n, n + 1] = self._A, self._B, 1.0
        found = scipy.linalg.expm(whole * dt)
        return found[:n, :n], found[:n, n], found[:n, n + 1]

    def _current(self, state: Array) -> Array:
        y = self._b * state[-1]
        return self._gain * (np.maximum(y, 0.0) + self._off * np.maximum(-y, 0.0))
