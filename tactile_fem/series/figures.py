"""Figures of reading: protocols and letters side by side, and what was taken for what."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem.output.plots import (
    ACROSS,
    DISPLACEMENT,
    INK,
    Outlines,
    draw_outlines,
    draw_rates,
    styled,
)
from tactile_fem.series.image import RateImage
from tactile_fem.series.legibility import Reading


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
    rows, columns = len(images), len(outlines)
    figure = Figure(figsize=(1.7 * columns + 1.2, 1.8 * rows + 0.5), layout="compressed")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for (protocol, of_letter), panels in zip(images.items(), grid, strict=True):
        brightest = max(image.rate_Hz.max(initial=1e-9) for image in of_letter.values())
        for axes, (letter, image) in zip(panels, of_letter.items(), strict=True):
            drawn = draw_rates(
                axes,
                image.along_mm,
                image.across_mm,
                image.rate_Hz,
                outlines[letter],
                brightest,
            )
            _frame(axes, image)
        panels[0].set_ylabel(f"{protocol}\nX (mm)", fontsize=8)
        bar = figure.colorbar(drawn, ax=panels, shrink=0.8, label="spikes/s")
        bar.outline.set_visible(False)
    for axes, letter in zip(grid[0], outlines, strict=True):
        axes.set_title(letter, fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("Displacement (mm)", fontsize=8)
    return figure


@styled
def confusion_figure(readings: Mapping[str, Mapping[float, Reading]]) -> Figure:
    """Draw which letter was read as which.

    Parameters
    ----------
    readings
        By protocol, a row each, and blur of the images in mm, a column each.
    """
    rows, columns = len(readings), len(next(iter(readings.values())))
    figure = Figure(figsize=(3.6 * columns, 3.6 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).flat
    titled = [
        (f"{protocol}, blur {width:g} mm", reading)
        for protocol, of_blur in readings.items()
        for width, reading in of_blur.items()
    ]
    for axes, (title, reading) in zip(panels, titled, strict=True):
        share = reading.confusion / reading.confusion.sum(axis=1, keepdims=True)
        axes.imshow(share, cmap="cividis", vmin=0, vmax=1)
        for (row, column), value in np.ndenumerate(share):
            if value > 0:
                colour = "black" if value > 0.6 else "white"
                text = f"{100 * value:.0f}"
                axes.text(column, row, text, ha="center", va="center", fontsize=6, color=colour)
        places = range(len(reading.letters))
        axes.set_xticks(places, reading.letters)
        axes.set_yticks(places, reading.letters)
        axes.set(xlabel="Read as", ylabel="Letter")
        axes.set_title(f"{title}: {100 * reading.accuracy:.0f} % right", fontsize=9)
    return figure


def _frame(axes: Axes, image: RateImage) -> None:
    """Show the whole image to scale; X falls upwards, so that letters stand upright."""
    half_row = (image.across_mm[1] - image.across_mm[0]) / 2
    axes.set_aspect("equal")
    axes.set_xlim(image.along_mm[0], image.along_mm[-1])
    axes.set_ylim(image.across_mm[-1] + half_row, image.across_mm[0] - half_row)
