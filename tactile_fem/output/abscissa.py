"""What a scan's figures and pictures are drawn over: displacement or time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from tactile_fem.output.plots import DISPLACEMENT, TIME, Outlines
from tactile_fem.simulation.results import Results
from tactile_fem.stimulus import outlines
from tactile_fem.study import AnyStimulus


@dataclass(frozen=True)
class Abscissa:
    """What is drawn over, from the end of the indentation on.

    For a steady slide along the finger, towards the palm, it is the displacement, which is also Y
    of the stimulator's outlines. For any other path it is the time.

    Attributes
    ----------
    label
        Of the axis.
    rows
        Which rows of the trace it has, (steps,).
    values
        At these rows.
    outlines
        Of the stimulator; none over time.
    """

    label: str
    rows: NDArray[np.bool_]
    values: NDArray[np.float64]
    outlines: Outlines = ()

    @classmethod
    def of(cls, results: Results) -> Abscissa:
        """Return what a scan is drawn over."""
        trace = results.trace
        rows = trace["time_s"] >= -1e-12
        slid, places = trace["displacement_mm"][rows], trace["stimulator_mm"][rows, :2]
        straight = places[:1] + slid[:, None] * [0.0, -1.0]
        if not np.allclose(places, straight, atol=1e-9) or (np.diff(slid) <= 0).any():
            return cls(TIME, rows, trace["time_s"][rows])
        shapes = rings(results.study.stimulus) if results.stimulator is None else []
        return cls(DISPLACEMENT, rows, slid, shapes)


def rings(stimulus: AnyStimulus) -> Outlines:
    """Return the outlines of what is raised as closed curves, holes turning the other way."""
    parts = shapely.get_parts([part for part in outlines(stimulus) if not part.is_empty])
    polygons = [shapely.geometry.polygon.orient(part) for part in parts]
    return [
        np.asarray(ring.coords)
        for polygon in polygons
        for ring in (polygon.exterior, *polygon.interiors)
    ]
