"""Histories of a scan as figures and films show them: over displacement or over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from tactile_fem.simulation.results import Results
from tactile_fem.study import Stimulus

Array = NDArray[np.float64]
Outlines = Sequence[Array]

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


def middle_row(receptors_mm: ArrayLike) -> NDArray[np.intp]:
    """Return the indices of the receptors on Y = 0, by rising X."""
    places = np.asarray(receptors_mm, dtype=float)
    row = np.flatnonzero(np.abs(places[:, 1]) < 1e-9)
    return row[np.argsort(places[row, 0])]


def at_time(trace: Mapping[str, Array], name: str, time_s: ArrayLike) -> Array:
    """Return a history at one time or many, by linear interpolation; times are the last axis."""
    values = trace[name]
    columns = values.reshape(len(values), -1).T
    found = np.array([np.interp(time_s, trace["time_s"], column) for column in columns])
    return found.reshape(values.shape[1:] + np.shape(time_s))


@dataclass(frozen=True)
class Abscissa:
    """The horizontal axis of the figures of a scan, from the end of the indentation on.

    For a steady slide along the finger, towards the palm, it is the displacement, which is also Y
    of the outlines of the stimulator. For any other path it is the time, without outlines.

    ``rows`` (steps,) selects the trace's rows, of which ``values`` are the coordinates.
    """

    label: str
    rows: NDArray[np.bool_]
    values: Array
    outlines: Outlines = ()

    @classmethod
    def of(cls, results: Results) -> Abscissa:
        """Return the axis of the figures of a scan."""
        trace = results.trace
        rows = trace["time_s"] >= -1e-12
        slid, places = trace["displacement_mm"][rows], trace["stimulator_mm"][rows, :2]
        straight = places[:1] + slid[:, None] * [0.0, -1.0]
        if not np.allclose(places, straight, atol=1e-9) or (np.diff(slid) <= 0).any():
            return cls(TIME, rows, trace["time_s"][rows])
        shapes = rings(results.study.stimulus) if results.stimulator is None else []
        return cls(DISPLACEMENT, rows, slid, shapes)


def rings(stimulus: Stimulus) -> Outlines:
    """Return the outlines of all raised parts as closed curves; holes turn the other way."""
    parts = shapely.get_parts([part for part in stimulus.outlines() if not part.is_empty])
    polygons = [shapely.geometry.polygon.orient(part) for part in parts]
    return [
        np.asarray(ring.coords)
        for polygon in polygons
        for ring in (polygon.exterior, *polygon.interiors)
    ]
