"""Histories of a scan as figures and films show them, and which kept state is meant."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.path.rotations import between

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

DISPLACEMENT, TIME = "Stimulator displacement (mm)", "Time (s)"
_TOLERANCE_MM, _TOLERANCE_S = 1e-6, 1e-6


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


def choose_state(
    displacement_mm: ArrayLike,
    time_s: ArrayLike,
    at_mm: float | None = None,
    at_s: float | None = None,
    apart_mm: float = 0.0,
) -> int:
    """Return the number of the only state at a displacement, at a time, or at both.

    `displacement_mm` and `time_s` are those of the states that were kept, (states,). By the
    displacement alone, states from the end of the indentation on are preferred: before it the
    displacement is 0. With the distance `apart_mm` of kept states, the nearest displacement counts.
    StudyError, without a subject, if there is none or several, as where the body holds and lifts.
    """
    slid, times = np.asarray(displacement_mm, dtype=float), np.asarray(time_s, dtype=float)
    there = np.full(len(times), True)
    wanted = []
    if at_mm is not None:
        at_mm = _nearest_mm(slid, at_mm, apart_mm) if apart_mm else at_mm
        there &= np.abs(slid - at_mm) < _TOLERANCE_MM
        wanted.append(f"{at_mm:g} mm")
    if at_s is not None:
        there &= np.isclose(times, at_s, rtol=1e-5, atol=_TOLERANCE_S)  # as messages round it
        wanted.append(f"{at_s:g} s")
    elif (there & (times > -_TOLERANCE_S)).any():
        there &= times > -_TOLERANCE_S
    found = np.flatnonzero(there)
    if len(found) == 1:
        return int(found[0])
    where = " and ".join(wanted)
    if len(found):
        listed = ", ".join(f"{time:.6g}" for time in times[found])
        raise StudyError(f"has several states at {where}: choose one by its time, {listed} s.")
    values, unit = (slid, "mm") if at_s is None else (times, "s")
    kept = _listed(values, unit) if len(values) else "set output.restarts for the scan"
    raise StudyError(f"has no state at {where}: {kept}.")


def _listed(values: Array, unit: str) -> str:
    """Return in words which states there are."""
    each = ", ".join(f"{value:.6g}" for value in dict.fromkeys(values.tolist()))
    return f"states were kept at {each} {unit}"


def _nearest_mm(slid_mm: Array, at_mm: float, apart_mm: float) -> float:
    nearest = float(slid_mm[np.argmin(np.abs(slid_mm - at_mm))])
    if not abs(nearest - at_mm) <= apart_mm:
        raise StudyError(f"has no state near {at_mm:g} mm: {_listed(slid_mm, 'mm')}.")
    if abs(nearest - at_mm) > _TOLERANCE_MM:
        logger.info("the kept state at %g mm is the nearest to %g mm", nearest, at_mm)
    return nearest
