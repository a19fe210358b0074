"""Images of firing: rate over the place on the stimulator, in both protocols."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Population, Response
from tactile_fem.neuron.afferent import checked_signed, fire
from tactile_fem.neuron.transduction import transduction_of
from tactile_fem.output.extrema import central_receptor, middle_row
from tactile_fem.scan.results import Results
from tactile_fem.study import Neuron

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

_UNEVEN = "For an image there must be three or more passes, evenly apart in X."


@dataclass(frozen=True)
class Sweep:
    """Histories whose receptors met the stimulator at X `across_mm`, by rising X.

    Attributes
    ----------
    time_s, felt
        (steps,) and what the afferents feel, (steps, rows); the slide begins at time 0.
    """

    across_mm: Array
    time_s: Array
    felt: Array
    speed_mm_s: float


@dataclass(frozen=True)
class RateImage:
    """Firing rate over the stimulator.

    Attributes
    ----------
    across_mm, along_mm
        Evenly rising X (rows,) and Y (columns,) of the place that is met.
    rate_Hz
        Spikes/s, (rows, columns).
    response
        The spikes it is made of, a row each; times from the start of the slide.
    """

    across_mm: Array
    along_mm: Array
    rate_Hz: Array
    response: Response


def population_histories(results: Results, population: str | None = None) -> Sweep:
    """Return what the receptors on the line Y = 0 felt in one scan.

    Parameters
    ----------
    population
        Which receptors; default the study's first population.

    Raises
    ------
    StudyError
        They are not evenly apart, or fewer than three.
    """
    trace, study = results.trace, results.study
    afferents, who = _population(results, population)
    line = who[middle_row(trace["receptors_mm"][who])]
    across = trace["receptors_mm"][line, 0]
    steps = np.diff(across)
    if len(across) < 3 or not np.allclose(steps, steps[0], atol=1e-6):
        raise StudyError(
            f"For an image the receptors on Y = 0 in {results.folder} must be three or more, "
            "evenly apart in X."
        )
    # What is at X of the body at rest is met by the receptor at X: body and finger share axes.
    time, felt = afferents.drive.of(trace)
    return Sweep(across, time, felt[:, line], study.protocol.speed_mm_s)


def fibre_histories(
    passes: Sequence[Results], base_mm: float = 0.0, population: str | None = None
) -> Sweep:
    """Return what a population's receptor at X = Y = 0 felt in passes with shifted stimulators.

    A stimulator shifted to s brings what lies at X = base - s, when it is shifted to the base, to
    the receptor. Where a pass is missing between others nothing is felt, and a warning is logged.

    Raises
    ------
    StudyError
        The shifts are fewer than three, or uneven, or more than half of them are missing, or the
        speeds differ.
    """
    if not passes:
        raise StudyError("There is no complete pass.")
    across = np.array([base_mm - results.study.stimulus.shift_mm[0] for results in passes])
    order = np.argsort(across)
    across, rows = _with_gaps(across[order])
    speeds = {results.study.protocol.speed_mm_s for results in passes}
    if len(speeds) > 1:
        raise StudyError(f"The passes have different speeds: {sorted(speeds)} mm/s.")
    # The steps differ between passes; between two of them the histories are linear.
    time = np.unique(np.concatenate([results.trace["time_s"] for results in passes]).round(12))
    felt = np.zeros((len(time), len(across)))
    for row, k in zip(rows, order, strict=True):
        afferents, who = _population(passes[k], population)
        central = who[central_receptor(passes[k].trace["receptors_mm"][who])]
        at, value = afferents.drive.of(passes[k].trace)
        felt[:, row] = np.interp(time, at, value[:, central])
    return Sweep(across, time, felt, speeds.pop())


def rate_image(
    sweep: Sweep, neuron: Neuron, *, column_mm: float = 0.2, window_mm: float = 0.2
) -> RateImage:
    """Return the firing rates that histories evoke.

    Parameters
    ----------
    neuron
        Constants; another ``seed`` gives another realization of its noise.
    column_mm
        Distance of the columns.
    window_mm
        Standard deviation of the Gaussian that spreads a spike along the scan.
    """
    time, felt = checked_signed(sweep.time_s, sweep.felt, "felt")
    fired = fire(time, felt, neuron, transduction_of(neuron))
    spikes = [times[times >= 0] for times in fired.spikes]
    response = Response(spikes, 0.0, fired.end_s)
    end = fired.end_s * sweep.speed_mm_s
    along = np.arange(0.0, end + 1e-9, column_mm)
    rate = response.rate(along / sweep.speed_mm_s, window_mm / sweep.speed_mm_s)
    return RateImage(sweep.across_mm, along, rate.T, response)


def population_image(
    results: Results, neuron: Neuron | None = None, population: str | None = None
) -> RateImage:
    """Return the image of one scan's receptors on Y = 0, with the study's neuron or another.

    Of several populations the first is shown unless another is named.
    """
    histories = population_histories(results, population)
    return rate_image(histories, neuron or _population(results, population)[0].neuron)


def fibre_image(
    passes: Sequence[Results],
    neuron: Neuron | None = None,
    base_mm: float = 0.0,
    population: str | None = None,
) -> RateImage:
    """Return the image that passes over one receptor make: the classic spatial event plot.

    It shows the stimulator as it lies when shifted to `base_mm`. The afferent is the same in all
    passes, so its gain does not vary between rows. The row of a pass that is missing between
    others is empty.
    """
    histories = fibre_histories(passes, base_mm, population)
    neuron = neuron or _population(passes[0], population)[0].neuron
    return rate_image(histories, neuron.model_copy(update={"gain_spread": 0.0}))


def _population(results: Results, name: str | None) -> tuple[Population, NDArray[np.intp]]:
    """Return a population and the indices of its receptors; the first one if none is named."""
    afferents = {one.name: one for one in results.study.populations}
    name = name or next(iter(afferents))
    who = results.receptors_of(name)
    return Population.of(afferents[name]), who


def thinned(image: RateImage, spacing_mm: float) -> RateImage:
    """Return the image with its rows `spacing_mm` apart, the middle one among them.

    Raises
    ------
    StudyError
        That is no multiple of the rows' distance, or leaves fewer than three.
    """
    own = image.across_mm[1] - image.across_mm[0]
    every = max(round(spacing_mm / own), 1)
    middle = len(image.across_mm) // 2
    rows = np.arange(middle % every, len(image.across_mm), every)
    if not np.isclose(every * own, spacing_mm) or len(rows) < 3:
        raise StudyError(
            f"Rows {spacing_mm:g} mm apart must be three or more of the image's, "
            f"which are {own:g} mm apart."
        )
    fired = image.response
    response = Response([fired.spikes[row] for row in rows], fired.start_s, fired.end_s)
    return RateImage(image.across_mm[rows], image.along_mm, image.rate_Hz[rows], response)


def _with_gaps(across: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return evenly rising places, those of missing passes among them, and the row of each pass."""
    step = np.diff(across).min(initial=np.inf)
    length = across[-1] - across[0]
    # Where more than half are missing, the passes are none of one series.
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
