"""Mean firing rates without spikes: of the model, and as recorded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.neuron.settings import Neuron
from tactile_fem.neuron.static import StaticDynamic
from tactile_fem.neuron.transduction import transduction_of

Array = NDArray[Any]
_SAMPLES_PER_WINDOW = 200  # at which the current is evaluated
_LEAST_HZ = 0.1  # that rates are divided by


class Window(NamedTuple):
    """A stretch of time and the mean rates in it."""

    start_s: float
    end_s: float
    rate_Hz: ArrayLike  # spikes/s, (receptors,)
    sd_Hz: ArrayLike = 1.0  # standard deviation of the rates, a number or (receptors,)


class Recording(NamedTuple):
    """Drive of the receptors in an experiment, and measured rates of their afferents.

    A recording of another `afferent` than the median one, which has no name, has a gain (a factor
    of the drive) and a threshold (relative to the median one) of its own. Rates of a `relative`
    recording are divided by those in its first window, of a `pooled` one they are means over its
    receptors. The receptors have met the like of the history for `contact_s` before.
    """

    time_s: ArrayLike  # (t,)
    drive: ArrayLike  # (t, receptors), for example in kPa
    windows: Sequence[Window]
    afferent: str = ""
    relative: bool = False
    pooled: bool = False
    contact_s: float = 0.0


def modelled_rates(
    recording: Recording, neuron: Neuron, gain: float = 1.0, threshold: float = 1.0
) -> Array:
    """Return the model's rates in the windows of a recording, (windows, receptors or 1).

    `gain` multiplies the drive and `threshold` that of the neuron; rates are those of
    `mean_rates`.
    """
    own = neuron.model_copy(update={"threshold_mV": threshold * neuron.threshold_mV})
    drive = gain * np.asarray(recording.drive, dtype=float)
    time = np.asarray(recording.time_s)
    rates = mean_rates(time, drive, recording.windows, own, recording.contact_s)
    if recording.pooled:
        rates = rates.mean(axis=1, keepdims=True)
    return rates / np.maximum(rates[0], _LEAST_HZ) if recording.relative else rates


def mean_rates(
    time_s: Array,
    drive: Array,
    windows: Sequence[Window],
    neuron: Neuron,
    contact_s: float = 0.0,
) -> Array:
    """Return the mean rates of the model, spikes/s, (windows, receptors).

    They are the steady rate of the membrane at the present current, averaged over the window: the
    limit of many trials with irregular spikes.
    """
    share = (np.arange(_SAMPLES_PER_WINDOW) + 0.5) / _SAMPLES_PER_WINDOW
    at = np.concatenate([w.start_s + share * (w.end_s - w.start_s) for w in windows])
    order = np.argsort(at, kind="stable")
    rates = np.empty((len(at), drive.shape[1]))
    rates[order] = rate_of(current_at(at[order], time_s, drive, neuron, contact_s), neuron)
    return rates.reshape(len(windows), _SAMPLES_PER_WINDOW, -1).mean(axis=1)


def rate_of(current_pA: ArrayLike, neuron: Neuron) -> Array:
    """Return the rate, spikes/s, at which a constant current, pA, makes the membrane fire.

    f = 1 / (t_ref - tau ln(1 - V_th/(R I))) above the rheobase V_th/R, otherwise 0.
    """
    limit_mV = np.asarray(current_pA, dtype=float) * neuron.resistance_GOhm
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = neuron.refractory_s - neuron.time_constant_s * np.log1p(
            -neuron.threshold_mV / limit_mV
        )
        return np.where(limit_mV > neuron.threshold_mV, 1 / interval, 0.0)


def current_at(
    at_s: Array, time_s: Array, drive: Array, neuron: Neuron, contact_s: float = 0.0
) -> Array:
    """Return the transduction current, pA, (times, receptors), at times within a history.

    At a jump it is the later value; the times increase. The history is as in
    `tactile_fem.neuron.respond`, after a contact as in `tactile_fem.neuron.Population.accustomed`.
    """
    own = transduction_of(neuron)
    if isinstance(own, StaticDynamic):
        return own.current_at(at_s, time_s, drive, contact_s)
    result = np.zeros((len(at_s), drive.shape[1]))
    columns = np.arange(drive.shape[1])
    for start, length, current, who in own.segments(time_s, drive):
        begin, end = np.broadcast_arrays(start, start + length)
        rows = np.flatnonzero((at_s >= np.min(begin)) & (at_s <= np.max(end)))
        if rows.size:
            at = at_s[rows, None]
            place = np.ix_(rows, columns[who])
            value = current.at(np.clip(at - begin, 0.0, length))
            result[place] = np.where((at >= begin) & (at <= end), value, result[place])
    return result
