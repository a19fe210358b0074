"""Images of firing: the rate over the place on the stimulator, as in a spatial event plot."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Population, Response
from tactile_fem.neuron.population import fire
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.histories import central_receptor
from tactile_fem.simulation.results import Results
from tactile_fem.study import Neuron

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

_UNEVEN = "An image needs three or more passes at equal distances in X."


@dataclass(frozen=True)
class RateImage:
    """Firing rate over the stimulator.

    Attributes
    ----------
    across_mm, along_mm
        Place on the stimulator: X of the rows and Y of the columns, both evenly rising.
    rate_Hz
        Spikes/s, (rows, columns).
    response
        The spikes behind it, one train per row; times from the start of the slide.
    """

    across_mm: Array
    along_mm: Array
    rate_Hz: Array
    response: Response


def rate_image(
    across_mm: Array,
    time_s: Array,
    felt: Array,
    speed_mm_s: float,
    population: Population,
    *,
    column_mm: float = 0.2,
    window_mm: float = 0.2,
) -> RateImage:
    """Return the firing rates that histories of what a population feels evoke.

    Parameters
    ----------
    across_mm
        (rows,) rising X of the stimulator that each receptor passes.
    time_s, felt
        (steps,) and (steps, rows); the slide begins at time 0.
    speed_mm_s
        Of the slide.
    population
        The afferents; another ``seed`` gives another realization of their noise.
    column_mm
        Distance between columns.
    window_mm
        Standard deviation of the Gaussian that smooths each spike along the scan.
    """
    fired = fire(time_s, felt, population.neuron, population.transduction)
    response = Response([times[times >= 0] for times in fired.spikes], 0.0, fired.end_s)
    along = np.arange(0.0, fired.end_s * speed_mm_s + 1e-9, column_mm)
    rate = response.rate(along / speed_mm_s, window_mm / speed_mm_s)
    return RateImage(across_mm, along, rate.T, response)


def fibre_image(
    passes: Sequence[Results], neuron: Neuron | None = None, population: str | None = None
) -> RateImage:
    """Return the image that passes over one receptor make: the classic spatial event plot.

    The receptor at X = Y = 0 passes over X = -s of a stimulator that is shifted by s. The
    afferent is the same in all passes, so its gain does not vary between rows. If a pass is
    missing between others, its row is empty and a warning is logged.

    Parameters
    ----------
    passes
        Complete scans, in any order.
    neuron
        Other constants than the study's.
    population
        Name of the afferents; default the study's first.

    Raises
    ------
    StudyError
        There are fewer than three passes, their shifts are uneven, more than half of them are
        missing, or their speeds differ.
    """
    if not passes:
        raise StudyError("There is no complete pass.")
    speeds = {_speed_mm_s(results) for results in passes}
    if len(speeds) > 1:
        raise StudyError(f"The passes have different speeds: {sorted(speeds)} mm/s.")
    passes = sorted(passes, key=lambda results: -results.study.stimulus.shift_mm[0])
    across, rows = _with_gaps(np.array([-one.study.stimulus.shift_mm[0] for one in passes]))
    traces = [results.trace for results in passes]
    known = {one.name: one for one in passes[0].study.populations}
    afferents = known[population or next(iter(known))].population()
    # Each pass has its own steps; histories are linear between them.
    time = np.unique(np.concatenate([trace["time_s"] for trace in traces]).round(12))
    felt = np.zeros((len(time), len(across)))
    for row, results in zip(rows, passes, strict=True):
        own = results.receptors_of(afferents.name)
        central = own[central_receptor(results.trace["receptors_mm"][own])]
        times, values = afferents.drive.of(results.trace)
        felt[:, row] = np.interp(time, times, values[:, central])
    neuron = (neuron or afferents.neuron).model_copy(update={"gain_spread": 0.0})
    return rate_image(across, time, felt, speeds.pop(), replace(afferents, neuron=neuron))


def _speed_mm_s(results: Results) -> float:
    """Return the speed of a slide; raise StudyError if the path is no straight slide."""
    over = Abscissa.of(results.trace)
    if not over.is_to_scale:
        raise StudyError(f"An image needs a straight slide, which {results.folder} is not.")
    return round(over.per_s, 9)


def _with_gaps(across: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return evenly rising X, including those of missing passes, and the row of each pass."""
    step = np.diff(across).min(initial=np.inf)
    length = across[-1] - across[0]
    # If more than half were missing, the passes would not belong to one series.
    if len(across) < 3 or length > 2 * len(across) * step:
        raise StudyError(_UNEVEN)
    rows = np.rint((across - across[0]) / step).astype(int)
    every = np.linspace(across[0], across[-1], rows[-1] + 1)
    if not np.allclose(every[rows], across, atol=1e-6):
        raise StudyError(_UNEVEN)
    missing = np.delete(every, rows)
    if len(missing):
        places = ", ".join(f"{x:g}" for x in missing)
        logger.warning("no complete pass at X = %s mm: the image is empty there", places)
    return every, rows
