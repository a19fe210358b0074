"""Images of firing: the rate over the place on the stimulator, as in a spatial event plot."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Population, Response
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.results.histories import central_receptor
from tactile_fem.results.results import Results
from tactile_fem.stimulus import Stimulus
from tactile_fem.study import Neuron

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Width of a blurred outline, of the order of the spread of a receptor's field; sub-pixels in each
# direction.
_BLUR_MM, _FINE = 0.3, 4

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

    def outline_correlation(self, stimulus: Stimulus, shift_mm: float = 1.0) -> float:
        """Return the largest correlation of firing with the outline of the raised shapes.

        Slowly adapting afferents fire at edges (Blake et al. 1997), therefore the image is compared
        with the outline rather than with the raised area.

        Parameters
        ----------
        stimulus
            Stimulus of the scan.
        shift_mm
            Largest shift in both directions; skin is dragged along.

        Raises
        ------
        StudyError
            The stimulus has no outline.
        """
        outline = outline_image(stimulus, self.across_mm, self.along_mm)
        pixels = self.across_mm[1] - self.across_mm[0], self.along_mm[1] - self.along_mm[0]
        shifts = round(shift_mm / pixels[0]), round(shift_mm / pixels[1])
        return float(correlations(self.rate_Hz[None], outline[None], shifts)[0, 0])


def outline_image(stimulus: Stimulus, across_mm: Array, along_mm: Array) -> Array:
    """Return the blurred outline of the raised shapes, (rows, columns), 1 at most.

    Raises
    ------
    StudyError
        The stimulus has no outline, or the image a single row or column.
    """
    shapes = [shape for shape in stimulus.outlines() if not shape.is_empty]
    if not shapes:
        raise StudyError(f'The stimulus "{stimulus.kind}" has no outline to compare with.')
    if min(len(across_mm), len(along_mm)) < 2:
        raise StudyError("An image to compare with an outline needs two rows and columns or more.")
    lines = shapely.unary_union([shape.boundary for shape in shapes])
    pixel = across_mm[1] - across_mm[0], along_mm[1] - along_mm[0]
    offsets = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    x = (across_mm[:, None] + offsets * pixel[0]).ravel()
    y = (along_mm[:, None] + offsets * pixel[1]).ravel()
    points = shapely.points(*np.meshgrid(x, y, indexing="ij"))
    near = np.exp(-0.5 * (shapely.distance(lines, points) / _BLUR_MM) ** 2)
    cells = near.reshape(len(across_mm), _FINE, len(along_mm), _FINE)
    return np.asarray(cells.mean(axis=(1, 3)))


def correlations(images: Array, templates: Array, max_shift: tuple[int, int]) -> Array:
    """Return the largest correlation of each image with each template over all shifts.

    Parameters
    ----------
    images, templates
        (images, rows, columns), (templates, rows, columns); a shifted template is zero beyond
        its border.
    max_shift
        Largest shift in rows and columns.

    Returns
    -------
    r
        Pearson's correlation over the whole image, (images, templates); 0 for a uniform image.
    """
    own = _normed(images.reshape(len(images), -1)).T
    border = [(shift, shift) for shift in max_shift]
    largest = []
    for template in templates:
        windows = sliding_window_view(np.pad(template, border), images.shape[1:])
        largest.append((_normed(windows.reshape(-1, len(own))) @ own).max(axis=0))
    return np.array(largest).T


def _normed(rows: Array) -> Array:
    """Return rows with mean 0 and length 1; uniform rows become 0."""
    centred = rows - rows.mean(axis=1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    return np.divide(centred, length, out=np.zeros_like(centred), where=length > 0)


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
    """Return the firing rates that histories of a population's drive evoke.

    Parameters
    ----------
    across_mm
        (rows,) rising X of the stimulator that each receptor passes.
    time_s, felt
        (steps,) and (steps, rows); the slide begins at time 0.
    speed_mm_s
        Speed of the slide.
    population
        The afferents; another ``seed`` gives another realization of their noise.
    column_mm
        Distance between columns.
    window_mm
        Standard deviation of the Gaussian that smooths each spike along the scan.
    """
    fired = population.respond(time_s, felt)
    response = Response([times[times >= 0] for times in fired.spikes], 0.0, fired.end_s)
    along = np.arange(0.0, fired.end_s * speed_mm_s + 1e-9, column_mm)
    rate = response.rate(along / speed_mm_s, window_mm / speed_mm_s)
    return RateImage(across_mm, along, rate.T, response)


def population_image(
    results: Results, neuron: Neuron | None = None, population: str | Population | None = None
) -> RateImage:
    """Return the image of the receptors of one scan on Y = 0.

    Parameters
    ----------
    results
        A complete scan with a slide.
    neuron
        Other constants than the study's.
    population
        Name of the afferents, or others in place of those of their name; default the study's first.

    Raises
    ------
    StudyError
        There are fewer than three such receptors, or they are not at equal distances; or the path
        is no straight slide.
    """
    trace, afferents = results.trace, _afferents(results, population)
    own = results.receptors_of(afferents.name)
    places = trace["receptors_mm"][own]
    middle = np.flatnonzero(np.abs(places[:, 1]) < 1e-9)
    row = middle[np.argsort(places[middle, 0])]
    across = places[row, 0]
    steps = np.diff(across)
    if len(across) < 3 or not np.allclose(steps, steps[0], atol=1e-6):
        raise StudyError(
            f"An image needs three or more receptors on Y = 0 at equal distances in X: "
            f"{results.folder} has {len(across)}."
        )
    # The receptor at X passes over the stimulator's X, because both share their axes.
    times, felt = afferents.felt(trace)
    afferents = replace(afferents, neuron=neuron or afferents.neuron)
    return rate_image(across, times, felt[:, row], _speed_mm_s(results), afferents)


def _afferents(results: Results, name: str | Population | None) -> Population:
    """Return the population of a name, the first without one, or the one that is given."""
    if isinstance(name, Population):
        return name
    known = {one.name: one for one in results.study.populations}
    return known[name or next(iter(known))].population()


def fibre_image(
    passes: Sequence[Results], neuron: Neuron | None = None, population: str | None = None
) -> RateImage:
    """Return the image of passes over one receptor: the classic spatial event plot.

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
    afferents = _afferents(passes[0], population)
    # Each pass has its own steps; histories are linear between them.
    time = np.unique(np.concatenate([trace["time_s"] for trace in traces]).round(12))
    felt = np.zeros((len(time), len(across)))
    for row, results in zip(rows, passes, strict=True):
        own = results.receptors_of(afferents.name)
        central = central_receptor(results.trace["receptors_mm"][own])
        times, values = afferents.felt(results.trace)
        felt[:, row] = np.interp(time, times, values[:, central])
    neuron = (neuron or afferents.neuron).model_copy(
        update={"gain_spread": 0.0, "threshold_spread": 0.0}
    )
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
