"""Draws everything that a results folder can show."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response, drive_of
from tactile_fem.output.histories import DISPLACEMENT, TIME, Abscissa, central_receptor, middle_row
from tactile_fem.output.pictures import draw_pictures
from tactile_fem.output.plots import firing_figure, force_figure, raster_figure, sed_figure
from tactile_fem.runtime.files import write_figure
from tactile_fem.simulation.results import Results
from tactile_fem.study import Afferents

logger = logging.getLogger(__name__)

Indices = NDArray[np.intp]

_MEETING_POINT = "Place on the stimulator that the receptor meets (mm)"
_RATE_COLUMNS = 201
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
    with ThreadPoolExecutor(1) as beside:  # it only waits for the process that draws the pictures
        pictures = beside.submit(draw_pictures, results)
        return [*draw_plots(results), *pictures.result()]


def draw_plots(results: Results) -> list[Path]:
    """Draw the figures that need no graphics library; return their files."""
    logger.info("drawing the figures of %s", results.folder)
    over = Abscissa.of(results)
    figures = {"force": _force(results, over)}
    slides = len(over.values) > 1
    if not slides:
        logger.warning(
            "The path in %s ends with its indentation: only forces are drawn.", results.folder
        )
    for afferents in results.study.populations if slides else ():
        own = results.receptors_of(afferents.name)
        for kind, figure_of in _POPULATION_FIGURES.items():
            name = f"{kind}_{afferents.name}" if results.study.afferents else kind
            figures[_SINGLE_NAMES.get(name, name)] = figure_of(results, afferents, own, over)
    results.figures.mkdir(exist_ok=True)
    drawn = {results.figures / f"{name}.png": figure for name, figure in figures.items() if figure}
    for path, figure in drawn.items():
        write_figure(path, figure)
    return list(drawn)


def _force(results: Results, over: Abscissa) -> Figure:
    trace = results.trace
    indenting = trace["time_s"] <= 1e-12
    return force_figure(
        (trace["depth_mm"][indenting], "Indentation (mm)", trace["force_N"][indenting]),
        (over.values, over.label, trace["force_N"][over.rows]),
        results.study.stimulus.friction,
        results.study.finger.force_unit,
    )


def _felt(results: Results, afferents: Afferents, own: Indices, over: Abscissa) -> Figure | None:
    """Draw what the central receptor of a population feels, if the trace has it."""
    trace = results.trace
    try:
        drive = drive_of(afferents.feels)
        _, felt = drive.of(trace)
    except StudyError as error:
        logger.warning("What %s afferents feel is not drawn: %s", afferents.name, error)
        return None
    central = own[central_receptor(trace["receptors_mm"][own])]
    x, y, _ = trace["receptors_mm"][central]
    return sed_figure(
        over.values,
        felt[over.rows, central],
        [outline - (0.0, y) for outline in over.outlines],
        x,
        (over.label, f"{drive.label} ({drive.unit})"),
    )


def _raster(results: Results, afferents: Afferents, own: Indices, over: Abscissa) -> Figure:
    """Draw spikes over the displacement, or over the place that the receptor meets."""
    places, spikes = results.trace["receptors_mm"], results.spikes
    shown = (spikes.time_s >= 0) & np.isin(spikes.receptor, own)
    receptor, at = spikes.receptor[shown], spikes.displacement_mm[shown]
    axis, ends, label = 0, (float(over.values[0]), float(over.values[-1])), over.label
    if label == TIME:
        at = spikes.time_s[shown]
    if _along_finger(results):
        axis = 1
    elif label == DISPLACEMENT:
        y = places[own, 1]
        at = at + places[receptor, 1]
        ends = float(y.min()), ends[1] + float(y.max())
        label = DISPLACEMENT if np.abs(y).max() < 1e-9 else _MEETING_POINT
    shapes = () if axis else over.outlines
    return raster_figure(
        at, places[receptor, axis], places[own, axis], ends, shapes, label, "XY"[axis]
    )


def _firing(results: Results, afferents: Afferents, own: Indices, over: Abscissa) -> Figure | None:
    """Draw the rates of the receptors on the line Y = 0, if they make an image."""
    places, spikes = results.trace["receptors_mm"], results.spikes
    axis = int(_along_finger(results))
    line = own[np.argsort(places[own, 1])] if axis else own[middle_row(places[own])]
    rows = places[line, axis]
    if len(rows) < 3 or not np.allclose(np.diff(rows), np.diff(rows)[0]):
        logger.info("firing.png needs an even line of receptors across the finger")
        return None
    columns = np.linspace(over.values[0], over.values[-1], _RATE_COLUMNS)
    times = np.interp(columns, over.values, results.trace["time_s"][over.rows])
    response = Response([spikes.time_s[spikes.receptor == k] for k in line], 0.0, times[-1])
    rate = response.rate(times, _WINDOW_S).T
    shapes = () if axis else over.outlines
    return firing_figure(columns, rows, rate, shapes, over.label, "XY"[axis])


def _along_finger(results: Results) -> bool:
    """Return whether the scan is that of a sagittal section."""
    places = results.trace["receptors_mm"]
    return results.study.finger.is_section and bool(np.ptp(places[:, 0]) < 1e-9)


# Figures of each population, and the name of one that has no population in it.
_POPULATION_FIGURES = {"felt": _felt, "raster": _raster, "firing": _firing}
_SINGLE_NAMES = {"felt": "sed"}
