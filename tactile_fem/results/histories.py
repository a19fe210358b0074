"""Histories of a scan as figures and films show them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.path.rotations import between

Array = NDArray[np.float64]

DISPLACEMENT, TIME = "Stimulator displacement (mm)", "Time (s)"


def extrema(values: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of local maxima and of local minima that are a tenth of the range high."""
    from scipy.signal import find_peaks  # takes 0.3 s, and few commands need it

    series = np.asarray(values, dtype=float)
    least = 0.1 * np.ptp(series) if len(series) else 0.0
    if least == 0.0:
        nothing = np.empty(0, dtype=np.intp)
        return nothing, nothing
    highs, _ = find_peaks(series, prominence=least)
    lows, _ = find_peaks(-series, prominence=least)
    return highs, lows


def central_receptor(receptors_mm: ArrayLike, population: ArrayLike | None = None) -> int:
    """Return the index of the receptor nearest to X = Y = 0, of the first population if named."""
    places = np.asarray(receptors_mm, dtype=float)
    apart = np.hypot(places[:, 0], places[:, 1])
    if population is not None:
        names = np.asarray(population)
        apart = np.where(names == names[0], apart, np.inf)
    return int(np.argmin(apart))


def at_time(trace: Mapping[str, Array], name: str, time_s: ArrayLike) -> Array:
    """Return a history at one time or many, by linear interpolation; times are the last axis."""
    values = trace[name]
    columns = values.reshape(len(values), -1).T
    times = np.asarray(time_s, dtype=float)
    found = np.array([np.interp(times, trace["time_s"], column) for column in columns])
    return found.reshape(values.shape[1:] + np.shape(time_s))


def mean_over(at: ArrayLike, values: ArrayLike) -> Array:
    """Return the mean of histories (n, ...) over a time or way `at`, (n,), not over the steps.

    They are linear between the samples, so that samples which add nothing change nothing. That of
    one sample, or of samples at one place, is the last value.
    """
    x, y = np.asarray(at, dtype=float), np.asarray(values, dtype=float)
    whole = x[-1] - x[0]
    return np.asarray(np.trapezoid(y, x, axis=0) / whole if whole > 0 else y[-1])


def turns_at(trace: Mapping[str, Array], time_s: ArrayLike) -> Array | None:
    """Return rotation vectors (times, 3) of the body; None if it does not turn."""
    turns = trace.get("stimulator_rad")  # which older folders lack
    return None if turns is None or not turns.any() else between(turns, trace["time_s"], time_s)
