"""What receptors feel over the whole path of a scan, and the outline that passes beneath them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import VERMILION
from tactile_fem.output.cross_section import CrossSectionMap, draw_outline
from tactile_fem.output.panels import legend_above, panels
from tactile_fem.output.plots import styled
from tactile_fem.results.histories import extrema

Array = NDArray[np.float64]

# Inches: the width, and the height of a single history and of each of several.
_WIDTH, _HEIGHT, _LOWER = 4.6, 2.2, 1.5
# Of the outline below: the largest heights likewise, and that of one that is not to scale.
_TALLEST, _TALLEST_OF_SEVERAL, _LOW = 4.0, 2.4, 1.2
_COLUMNS, _AROUND_MM = 900, 0.5
_LETTERS_PER_INCH = 13  # of a label


class Felt(NamedTuple):
    """What one receptor of a population feels: its place (3,), and (steps,) values of a drive."""

    name: str
    colour: str
    place_mm: Array
    label: str
    values: Array


@styled
def felt(histories: Sequence[Felt], over: Abscissa, beneath: CrossSectionMap) -> Figure:
    """Draw what receptors feel, one panel for each drive; local extrema of a single one are marked.

    Below is the outline of the stimulator beneath the first of them, with the ways of all.
    """
    labels = list(dict.fromkeys(one.label for one in histories))
    inside, x_mm = _passing(histories, over, beneath)
    height, tallest = (_HEIGHT, _TALLEST) if len(labels) == 1 else (_LOWER, _TALLEST_OF_SEVERAL)
    heights = [height] * len(labels)
    if x_mm is not None:
        heights.append(min(tallest, _height(over, inside, x_mm)))
    wide = int(_LETTERS_PER_INCH * height)
    figure, axes = panels(heights, over, _WIDTH, top=0.6 if len(histories) > 1 else 0.45)
    for one_axes, label in zip(axes, labels, strict=False):
        own = [one for one in histories if one.label == label]
        for one in own:
            one_axes.plot(over.values, one.values, color=one.colour, label=one.name)
        if len(histories) == 1:
            _mark_extrema(one_axes, over.values, own[0].values)
        low = min(one.values.min(initial=0.0) for one in own)
        high = max(one.values.max(initial=1e-12) for one in own)
        one_axes.set(ylim=(1.08 * low, 1.08 * high), ylabel=textwrap.fill(label, wide))
    if x_mm is not None:
        draw_outline(axes[-1], over.at(over.columns_s(_COLUMNS)), x_mm, inside)
        for one in histories:
            axes[-1].axhline(one.place_mm[0], color=one.colour, lw=1, ls=(0, (4, 3)), zorder=1)
        low, high = float(x_mm[0]), float(x_mm[-1])
        if over.is_to_scale:  # only as much as fits
            shown = min(high - low, heights[-1] / _WIDTH * float(np.ptp(over.ends)))
            low = min(max(low, histories[0].place_mm[0] - shown / 2), high - shown)
            high = low + shown
        axes[-1].set(ylim=(high, low), ylabel="X (mm)")
    if len(histories) > 1:
        legend_above(axes)
    return figure


def _mark_extrema(axes: Axes, at: Array, values: Array) -> None:
    highs, lows = extrema(values)
    axes.plot(at[highs], values[highs], "o", color=VERMILION, ms=4.5, label="maxima")
    axes.plot(at[lows], values[lows], "o", mfc="white", mec=VERMILION, ms=4.5, label="minima")
    marked = [line for line in axes.lines[-2:] if len(line.get_xdata())]
    if marked:
        axes.legend(handles=marked, loc="best", fontsize=8, handletextpad=0.2)


def _passing(
    histories: Sequence[Felt], over: Abscissa, beneath: CrossSectionMap
) -> tuple[Array, Array | None]:
    """Return what passes beneath the first receptor's Y, (x, columns), and X; None if nothing."""
    x_mm, times = beneath.x_mm, over.columns_s(_COLUMNS)
    y = np.full(len(x_mm), histories[0].place_mm[1])
    inside = beneath.under(np.column_stack([x_mm, y]), times)
    raised = x_mm[(inside > 0).any(axis=1)]
    if not len(raised) or inside.min() > 0:
        return inside, None
    own = [one.place_mm[0] for one in histories]
    low, high = min(raised.min(), *own) - _AROUND_MM, max(raised.max(), *own) + _AROUND_MM
    shown = (x_mm >= low) & (x_mm <= high)
    return inside[shown], x_mm[shown]


def _height(over: Abscissa, inside: Array, x_mm: Array) -> float:
    """Return the height, inches, of the outline: to scale unless it is the same everywhere in X."""
    raised = inside > 0
    if not over.is_to_scale or np.array_equal(raised.any(axis=0), raised.all(axis=0)):
        return _LOW
    return _WIDTH * float(np.ptp(x_mm) / np.ptp(over.ends))
