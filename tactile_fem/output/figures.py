"""Draws everything that a results folder can show."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from pathlib import Path

from matplotlib.figure import Figure

from tactile_fem.errors import StudyError
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import BLUE, colours_of
from tactile_fem.output.cross_section import CrossSectionMap
from tactile_fem.output.felt import Felt, felt
from tactile_fem.output.measured import measured
from tactile_fem.output.pictures import draw_pictures
from tactile_fem.output.plots import force_figure
from tactile_fem.output.rasters import Trains, firing, raster
from tactile_fem.output.snapshots import snapshots
from tactile_fem.results.histories import central_receptor
from tactile_fem.results.results import Results
from tactile_fem.runtime.files import Print, write_figure

logger = logging.getLogger(__name__)


def draw(
    results: Results | Path | str, *, dpi: int | None = None, width_mm: float | None = None
) -> list[Path]:
    """Draw all figures and, where that is possible, the pictures; return their files.

    Parameters
    ----------
    results
        A scan's results or their folder.
    dpi
        Dots per inch of the files; default 200. Sizes in inches and text stay as they are.
    width_mm
        Width of all figures in print, for which they are laid out anew: letters keep 3/4 of their
        size in points or more. Default: each figure's own.

    Raises
    ------
    StudyError
        The folder holds no results.
    """
    if not isinstance(results, Results):
        results = Results.open(results)
    with Print(width_mm, dpi).used(), ThreadPoolExecutor(1) as beside:
        # It only waits for the process that draws the pictures.
        drawn = beside.submit(copy_context().run, draw_pictures, results)
        return [*draw_plots(results), *drawn.result()]


def draw_plots(results: Results) -> list[Path]:
    """Draw the figures that need no graphics library; return their files.

    Of a scan without a step there are only forces.
    """
    logger.info("drawing the figures of %s", results.folder)
    over = Abscissa.of(results.trace)
    friction, unit = results.study.stimulus.law().uniform, results.study.finger.force_unit
    forces = force_figure(results.trace, over, friction, unit)
    figures: dict[str, Figure | None] = {"force": forces}
    if len(over.values) > 1:
        beneath, trains = CrossSectionMap.of(results), trains_of(results)
        figures["felt" if results.study.afferents else "sed"] = _felt(results, over, beneath)
        kinds = {"raster": raster, "firing": firing, "snapshots": snapshots}
        figures |= {name: kind(trains, over, beneath) for name, kind in kinds.items()}
        figures["measured"] = measured(results, over)
    results.figures.mkdir(exist_ok=True)
    drawn = {results.figures / f"{name}.png": figure for name, figure in figures.items() if figure}
    for path, figure in drawn.items():
        write_figure(path, figure)
    return list(drawn)


def trains_of(results: Results) -> list[Trains]:
    """Return the spikes of each population of a scan."""
    found, places = results.response, results.trace["receptors_mm"]
    colours = colours_of(one.name for one in results.study.populations)
    own = {name: results.receptors_of(name) for name in colours}
    return [Trains(name, colours[name], places[k], found.of(k)) for name, k in own.items()]


def _felt(results: Results, over: Abscissa, beneath: CrossSectionMap) -> Figure | None:
    """Draw what the central receptor of each population feels, if the trace has it."""
    trace, found = results.trace, list[Felt]()
    colours = colours_of(one.name for one in results.study.populations)
    for afferents in results.study.populations:
        own = results.receptors_of(afferents.name)
        try:
            population = afferents.population()
            drive, (_, values) = population.drive, population.felt(trace)
        except StudyError as error:
            logger.warning("The drive of %s afferents is not drawn: %s", afferents.name, error)
            continue
        central = central_receptor(trace["receptors_mm"][own])
        place, unit = trace["receptors_mm"][own[central]], f" ({drive.unit})"
        label = drive.label.replace(" - ", "\u00a0\u2212\u00a0") + unit.replace(" (1)", "")
        colour = colours[afferents.name] if len(colours) > 1 else BLUE
        found.append(Felt(afferents.name, colour, place, label, values[:, central]))
    return felt(found, over, beneath) if found else None
