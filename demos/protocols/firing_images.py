"""Images of firing of a population, and figures of them; used by the demos here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem import Results, StudyError
from tactile_fem.neuron import Response
from tactile_fem.output.annotations import INK
from tactile_fem.output.histories import DISPLACEMENT, Outlines
from tactile_fem.output.plots import ACROSS, draw_outlines, draw_rates, styled
from tactile_fem.series import RateImage, rate_image
from tactile_fem.study import Neuron

_COLUMNS = 9  # of letters


def population_image(
    results: Results, neuron: Neuron | None = None, name: str | None = None
) -> RateImage:
    """Return the image of one scan's receptors on Y = 0, with the study's neuron or another.

    Of several populations it is the first one's, or that of a name.

    Raises
    ------
    StudyError
        There are fewer than three such receptors, or they are not at equal distances.
    """
    trace, study = results.trace, results.study
    named = {population.name: population for population in study.populations}
    afferents = (named[name] if name else study.populations[0]).population()
    own = results.receptors_of(afferents.name)
    places = trace["receptors_mm"][own]
    middle = np.flatnonzero(np.abs(places[:, 1]) < 1e-9)
    row = own[middle[np.argsort(places[middle, 0])]]
    across = trace["receptors_mm"][row, 0]
    steps = np.diff(across)
    if len(across) < 3 or not np.allclose(steps, steps[0], atol=1e-6):
        raise StudyError(
            f"An image needs three or more receptors on Y = 0 at equal distances in X: "
            f"{results.folder} has {len(across)}."
        )
    # The receptor at X passes over the stimulator's X, because both share their axes.
    times, felt = afferents.drive.of(trace)
    afferents = replace(afferents, neuron=neuron or afferents.neuron)
    return rate_image(across, times, felt[:, row], study.protocol.speed_mm_s, afferents)


def with_row_spacing(image: RateImage, spacing_mm: float) -> RateImage:
    """Return an image with only those rows that are `spacing_mm` apart, the middle one included.

    Raises
    ------
    StudyError
        The spacing is not a multiple of the image's, or leaves fewer than three rows.
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
    response = image.response
    spikes = [response.spikes[row] for row in rows]
    response = Response(spikes, response.start_s, response.end_s)
    return RateImage(image.across_mm[rows], image.along_mm, image.rate_Hz[rows], response)


@styled
def side_by_side(images: Mapping[str, RateImage], outlines: Outlines = ()) -> Figure:
    """Draw spikes above and firing rates below, a column for each image.

    Parameters
    ----------
    images
        By their titles, over the same places.
    outlines
        As for `tactile_fem.output.plots.raster_figure`.
    """
    figure = Figure(figsize=(3.4 * len(images), 6.4), layout="compressed")
    grid = figure.subplots(2, len(images), sharex=True, sharey=True, squeeze=False)
    brightest = max(image.rate_Hz.max(initial=1e-9) for image in images.values())
    drawn = None
    for (title, image), (top, below) in zip(images.items(), grid.T, strict=True):
        speed = image.along_mm[-1] / max(image.response.end_s, 1e-12)
        row, times = image.response.events()
        draw_outlines(top, outlines)
        dots = {"ls": "none", "marker": "o", "ms": 1.5, "mew": 0, "color": INK, "zorder": 3}
        top.plot(times * speed, image.across_mm[row], **dots)
        top.set_title(f"{title}: {len(times)} spikes", fontsize=9)
        drawn = draw_rates(
            below, image.along_mm, image.across_mm, image.rate_Hz, outlines, brightest
        )
        below.set_xlabel(DISPLACEMENT)
        for axes in (top, below):
            _frame(axes, image)
    for axes in grid[:, 0]:
        axes.set_ylabel(ACROSS.replace("Receptor position", "Place"), fontsize=8)
    bar = figure.colorbar(drawn, ax=grid[1], shrink=0.8, label="Firing rate (spikes/s)")
    bar.outline.set_visible(False)
    return figure


@styled
def letters_figure(
    images: Mapping[str, Mapping[str, RateImage]], outlines: Mapping[str, Outlines]
) -> Figure:
    """Draw firing rates, a row for each protocol and a column for each letter.

    Parameters
    ----------
    images
        By protocol and letter.
    outlines
        By letter, as for `tactile_fem.output.plots.raster_figure`.
    """
    columns = min(len(outlines), _COLUMNS)
    lines = -(-len(outlines) // columns)
    size = (1.7 * columns + 1.2, 1.8 * lines * len(images) + 0.5)
    figure = Figure(figsize=size, layout="compressed")
    shape = (lines * len(images), columns)
    grid = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False)
    blocks = grid.reshape(len(images), lines * columns)
    for (protocol, of_letter), panels in zip(images.items(), blocks, strict=True):
        brightest = max(image.rate_Hz.max(initial=1e-9) for image in of_letter.values())
        for axes, (letter, image) in zip(panels, of_letter.items(), strict=False):
            drawn = draw_rates(
                axes, image.along_mm, image.across_mm, image.rate_Hz, outlines[letter], brightest
            )
            axes.set_title(letter, fontsize=9)
            _frame(axes, image)
        for axes in panels[len(of_letter) :]:
            axes.set_visible(False)
        for axes in panels[::columns]:
            axes.set_ylabel(f"{protocol}\nX (mm)", fontsize=8)
        bar = figure.colorbar(drawn, ax=panels, shrink=0.8, label="spikes/s")
        bar.outline.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("Displacement (mm)", fontsize=8)
    return figure


def _frame(axes: Axes, image: RateImage) -> None:
    """Show the whole image to scale; X falls upwards, so that letters stand upright."""
    half_row = (image.across_mm[1] - image.across_mm[0]) / 2
    axes.set_aspect("equal")
    axes.set_xlim(image.along_mm[0], image.along_mm[-1])
    axes.set_ylim(image.across_mm[-1] + half_row, image.across_mm[0] - half_row)
