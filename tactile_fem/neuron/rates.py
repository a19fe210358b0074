"""Steady firing of the membrane: from current to rate and back; the current of a history."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.neuron.transduction import transduction_of
from tactile_fem.study import Neuron

Array = NDArray[Any]


def rate_of(current_pA: ArrayLike, neuron: Neuron) -> Array:
    """Return the rate, spikes/s, at which a constant current, pA, makes the membrane fire.

    f = 1 / (t_ref - tau ln(1 - V_th/(R I))) above the rheobase V_th/R, otherwise 0.
    """
    drive = np.asarray(current_pA, dtype=float) * neuron.resistance_GOhm
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = neuron.refractory_s - neuron.time_constant_s * np.log1p(
            -neuron.threshold_mV / drive
        )
        return np.where(drive > neuron.threshold_mV, 1 / interval, 0.0)


def current_of(rate_Hz: ArrayLike, neuron: Neuron) -> Array:
    """Return the constant current, pA, that fires at a rate, spikes/s; the rheobase for 0.

    I = (V_th/R) / (1 - exp(-(1/f - t_ref)/tau)); infinite from 1/t_ref on.
    """
    with np.errstate(divide="ignore"):
        wait = np.maximum(1 / np.asarray(rate_Hz, dtype=float) - neuron.refractory_s, 0.0)
        charged = -np.expm1(-wait / neuron.time_constant_s)
        return neuron.threshold_mV / neuron.resistance_GOhm / charged


def current_at(at_s: Array, time_s: Array, sed_kPa: Array, neuron: Neuron) -> Array:
    """Return the transduction current, pA, (times, receptors), of a history at some times.

    Parameters
    ----------
    at_s
        (times,) within the history; at a jump the later value counts.
    time_s, sed_kPa
        As in `tactile_fem.neuron.respond`.
    neuron
        The constants.
    """
    result = np.zeros((len(at_s), sed_kPa.shape[1]))
    columns = np.arange(sed_kPa.shape[1])
    for start, length, current, who in transduction_of(neuron).segments(time_s, sed_kPa):
        begin, end = np.broadcast_arrays(start, start + length)
        rows = np.flatnonzero((at_s >= np.min(begin)) & (at_s <= np.max(end)))
        if rows.size:
            at = at_s[rows, None]
            place = np.ix_(rows, columns[who])
            value = current.at(np.clip(at - begin, 0.0, length))
            result[place] = np.where((at >= begin) & (at <= end), value, result[place])
    return result
