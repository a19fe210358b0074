"""Draws everything that a results folder can show."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import shapely
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response, drive_of
from tactile_fem.output.extrema import central_receptor, middle_row
from tactile_fem.output.pictures import draw_pictures
from tactile_fem.output.plots import (
    DISPLACEMENT,
    Outlines,
    firing_figure,
    force_figure,
    raster_figure,
    sed_figure,
)
from tactile_fem.runtime.files import write_figure
from tactile_fem.scan.results import Results
from tactile_fem.stimulus import outlines
from tactile_fem.study import Afferents, AnyStimulus

logger = logging.getLogger(__name__)

Indices = NDArray[np.intp]

_MET = "Place on the stimulator that the receptor meets (mm)"
_COLUMN_MM = 0.05
# Standard deviation of the Gaussian that spreads a spike.
_WINDOW_S = 0.01


def draw(results: Results | Path | str) -> list[Path]:
    """Draw all figures and, where that is possible, the pictures; return their files.

    Raises
    ------
    StudyError
        The folder holds no results.
    """
    if not isinstance(results, Results):
        results = Results.open(results)
    return [*draw_plots(results), *draw_pictures(results)]


def draw_plots(results: Results) -> list[Path]:
    """Draw the figures that need no graphics library."""
    shapes = rings(results.study.stimulus)
    figures = {"force": _force(results)}
    if (results.trace["displacement_mm"] > 0).any():
        for afferents in results.study.populations:
            who = results.receptors_of(afferents.name)
            end = f"_{afferents.name}" if results.study.afferents else ""
            own = {
                f"felt{end}" if end else "sed": _felt(results, afferents, who, shapes),
                f"raster{end}": _raster(results, who, shapes),
                f"firing{end}": _firing(results, who, shapes),
            }
            figures |= {name: figure for name, figure in own.items() if figure}
    else:
        logger.warning("There is no slide in %s: only forces are drawn.", results.folder)
    results.figures.mkdir(exist_ok=True)
    paths = []
    for name, figure in figures.items():
        path = results.figures / f"{name}.png"
        write_figure(path, figure)
        paths.append(path)
    return paths


def rings(stimulus: AnyStimulus) -> Outlines:
    """Return the outlines of what is raised as closed curves, holes turning the other way."""
    parts = shapely.get_parts([part for part in outlines(stimulus) if not part.is_empty])
    polygons = [shapely.geometry.polygon.orient(part) for part in parts]
    return [
        np.asarray(ring.coords)
        for polygon in polygons
        for ring in (polygon.exterior, *polygon.interiors)
    ]


def _slide(results: Results) -> NDArray[np.bool_]:
    """Return which steps belong to the slide, the end of the indentation included."""
    return np.asarray(results.trace["time_s"] >= -1e-12)


def _felt(results: Results, afferents: Afferents, who: Indices, shapes: Outlines) -> Figure | None:
    """Draw what the central receptor of a population feels, if that can be told here."""
    trace, slide = results.trace, _slide(results)
    try:
        drive = drive_of(afferents.feels)
        _, felt = drive.of(trace)
    except StudyError as error:
        logger.warning("What %s afferents feel is not drawn: %s", afferents.name, error)
        return None
    central = who[central_receptor(trace["receptors_mm"][who])]
    x, y, _ = trace["receptors_mm"][central]
    return sed_figure(
        trace["displacement_mm"][slide],
        felt[slide, central],
        [outline - (0.0, y) for outline in shapes],
        x,
        f"{drive.label} ({drive.unit})",
    )


def _raster(results: Results, who: Indices, shapes: Outlines) -> Figure:
    places, spikes = results.trace["receptors_mm"], results.spikes
    slide = (spikes.time_s >= 0) & np.isin(spikes.receptor, who)
    receptor, own = spikes.receptor[slide], places[who]
    on_a_line = bool(np.ptp(own[:, 1]) < 1e-9)
    met = spikes.displacement_mm[slide] + places[receptor, 1]
    end = results.trace["displacement_mm"][-1]
    return raster_figure(
        met,
        places[receptor, 0],
        own[:, 0],
        (float(own[:, 1].min()), float(end + own[:, 1].max())),
        shapes,
        DISPLACEMENT if on_a_line and abs(own[0, 1]) < 1e-9 else _MET,
    )


def _firing(results: Results, who: Indices, shapes: Outlines) -> Figure | None:
    """Draw the rates of the receptors on the line Y = 0, if they make an image."""
    places, spikes = results.trace["receptors_mm"], results.spikes
    line = who[middle_row(places[who])]
    rows = places[line, 0]
    if len(rows) < 3 or not np.allclose(np.diff(rows), np.diff(rows)[0]):
        logger.info("firing.png wants an even line of receptors across the finger")
        return None
    columns = np.arange(0.0, results.trace["displacement_mm"][-1] + 1e-9, _COLUMN_MM)
    times = columns / results.study.protocol.speed_mm_s
    response = Response([spikes.time_s[spikes.receptor == k] for k in line], 0.0, times[-1])
    rate = response.rate(times, _WINDOW_S).T
    return firing_figure(columns, rows, rate, shapes)


def _force(results: Results) -> Figure:
    trace = results.trace
    pressing = trace["time_s"] <= 1e-12
    return force_figure(
        trace["depth_mm"],
        trace["displacement_mm"],
        trace["force_N"],
        pressing,
        results.study.stimulus.friction,
    )
