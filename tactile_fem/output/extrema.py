"""Extrema of a history; the central receptor and the row of receptors through it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def extrema(
    values: ArrayLike, prominence: float = 0.1
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of local maxima and of local minima of a history.

    A maximum is at least `prominence` above its surroundings (a minimum below them), as a fraction
    of the range; smaller oscillations are ignored.
    """
    from scipy.signal import find_peaks  # takes 0.3 s, and few commands need it

    series = np.asarray(values, dtype=float)
    least = prominence * np.ptp(series) if len(series) else 0.0
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


def middle_row(receptors_mm: ArrayLike) -> NDArray[np.intp]:
    """Return the indices of the receptors on Y = 0, by rising X."""
    places = np.asarray(receptors_mm, dtype=float)
    row = np.flatnonzero(np.abs(places[:, 1]) < 1e-9)
    return row[np.argsort(places[row, 0])]
