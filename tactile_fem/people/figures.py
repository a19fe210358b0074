"""Figures of people, as wide as a column of a page: each takes arrays and returns a Figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike, NDArray

from tactile_fem.output import BLUE, DISTINCT, INK, VERMILION, Abscissa, draw_spikes, styled
from tactile_fem.output.panels import panels
from tactile_fem.people.bands import SHARES, Bands, bands
from tactile_fem.people.causes import REST, Causes
from tactile_fem.people.paired import paired

Array = NDArray[np.float64]

# Inches.
_WIDTH, _HEIGHT, _ROW, _LINE = 2.5, 1.05, 0.2, 0.19
_GREY, _SMALL_PT = "#9AA3AD", 8
_LIGHTEST, _DARKEST = 0.18, 0.4


@styled
def bands_figure(
    histories: Mapping[str, Mapping[str, ArrayLike]],
    over: Abscissa,
    shares: Sequence[float] = SHARES,
) -> Figure:
    """Draw the median of people and their bands, a panel for each quantity.

    Parameters
    ----------
    histories
        Values (people, steps) by the label of the panel, with its unit, and by the condition (at
        most six differ in colour), with the same names in each panel. Values that are not finite
        are left out.
    over
        The axis; its values are those of the steps.
    shares
        Probabilities of the bands. The legend has smaller ones where people are too few for them.
    """
    found = {
        label: {name: bands(values, shares) for name, values in conditions.items()}
        for label, conditions in histories.items()
    }
    names = list(next(iter(found.values())))
    each = [own for conditions in found.values() for own in conditions.values()]
    legend = [Line2D([], [], color=INK, label="median"), *_patches(each, shares)]
    if len(names) > 1:
        colours = zip(names, cycle(DISTINCT), strict=False)
        legend = [Line2D([], [], color=c, label=name) for name, c in colours] + legend
    rows = -(-len(legend) // 3)
    figure, axes = panels([_HEIGHT] * len(found), over, _WIDTH, top=0.5 + rows * _LINE)
    for one, (label, conditions) in zip(axes, found.items(), strict=True):
        for own, colour in zip(conditions.values(), cycle(DISTINCT), strict=False):
            _draw_bands(one, over.values, own, colour)
        one.set_ylabel(label, fontsize=_SMALL_PT)
        one.margins(y=0.05)
        if one.dataLim.y0 >= 0:
            one.set_ylim(bottom=0)
    style: dict[str, Any] = {"ncols": 3, "fontsize": 7.5, "columnspacing": 1.0, "borderpad": 0.2}
    sample = {"title": _sample(each), "title_fontsize": 7.5}
    figure.legend(handles=legend, loc="upper center", handlelength=1.3, **style, **sample)
    return figure


def _sample(each: Sequence[Bands]) -> str:
    """Return how many people have values, and how many there are."""
    counts = np.concatenate([own.people.ravel() for own in each])
    ends = " to ".join(map(str, np.unique([counts.min(), counts.max()])))
    return f"{ends} of {max(own.missing + own.people.max() for own in each)} people"


def _draw_bands(axes: Axes, at: Array, own: Bands, colour: str) -> None:
    """Draw the widest band first, the narrower ones darker."""
    widest_first = np.argsort(own.shares)[::-1]
    for k, alpha in zip(widest_first, _alphas(len(widest_first)), strict=True):
        axes.fill_between(at, own.low[k], own.high[k], color=colour, alpha=alpha, lw=0)
    axes.plot(at, own.median, color=colour, lw=1.3)


def _patches(each: Sequence[Bands], shares: Sequence[float]) -> list[Patch]:
    covered = np.min([own.covered for own in each], axis=0)
    widest_first = np.argsort(shares)[::-1]
    patches = [
        Patch(color=INK, alpha=alpha, lw=0, label=f"{100 * covered[k]:.0f} % of people")
        for k, alpha in zip(widest_first, _alphas(len(shares)), strict=True)
    ]
    return patches[::-1]


def _alphas(count: int) -> Array:
    return np.linspace(_LIGHTEST, _DARKEST, count)


@styled
def people_raster(
    spikes: Sequence[ArrayLike | None], over: Abscissa, order: ArrayLike, label: str
) -> Figure:
    """Draw the spikes of one receptor of many people, a row for each, ordered by a number.

    Parameters
    ----------
    spikes
        Places of each person's spikes on the axis; None without a scan, which is counted above.
    over
        The axis.
    order, label
        Number (people,) drawn at the right, the smallest at the bottom, and its name with the unit.
    """
    number = np.asarray(order, dtype=float)
    rows = [int(k) for k in np.argsort(number) if spikes[k] is not None]
    height = float(np.clip(0.07 * len(rows), 1.0, 4.5))
    figure, (axes,) = panels([height], over, _WIDTH - 0.6, right=0.85, top=0.5, below=0.15)
    times = [np.asarray(spikes[k], dtype=float) for k in rows]
    draw_spikes(
        axes, np.concatenate([[], *times]), np.repeat(range(len(rows)), list(map(len, times)))
    )
    box = axes.get_position()
    beside = figure.add_axes((box.x1 + 0.05, box.y0, 0.92 - box.x1, box.height), sharey=axes)
    beside.plot(number[rows], np.arange(len(rows)), "o", ms=2, color=BLUE, mew=0)
    beside.tick_params(labelleft=False, left=False)
    beside.set_xlabel(label.replace(" (", "\n("), fontsize=_SMALL_PT)
    beside.locator_params(axis="x", nbins=2, steps=[1, 2, 5, 10])
    beside.xaxis.set_major_formatter("{x:g}")
    axes.set(ylim=(-0.7, len(rows) - 0.3), yticks=[])
    missing = len(spikes) - len(rows)
    axes.set_ylabel(f"{len(rows)} people" + (f"\n({missing} without a scan)" if missing else ""))
    axes.yaxis.set_label_coords(-0.06, 0.5)
    return figure


@styled
def causes_figure(numbers: Mapping[str, Causes]) -> Figure:
    """Draw the share of each constant in the variance of numbers (at most six) by their names.

    The constants have the order of their largest shares; a line is the 95 % interval.
    """
    largest = {
        name: max(own.shares[name].value for own in numbers.values())
        for name in next(iter(numbers.values())).shares
    }
    names = [REST, *sorted(largest, key=lambda name: largest[name])]
    thick = 0.8 / len(numbers)
    height = 0.75 + len(names) * max(_ROW, 0.1 * len(numbers)) + _LINE * (len(numbers) > 1)
    figure = Figure(figsize=(_WIDTH + 1.1, height), layout="constrained")
    axes = figure.subplots()
    for k, ((name, own), colour) in enumerate(zip(numbers.items(), cycle(DISTINCT), strict=False)):
        found = [own.rest if cause == REST else own.shares[cause] for cause in names]
        value, low, high = 100 * np.array([(e.value, e.low, e.high) for e in found]).T
        at = np.arange(len(names)) + 0.4 - thick * (k + 0.5)
        axes.barh(at, value, 0.9 * thick, color=colour, label=name)
        ends = [value - low, high - value]
        axes.errorbar(value, at, xerr=ends, fmt="none", ecolor=INK, elinewidth=0.8)
    axes.set_yticks(range(len(names)), names, fontsize=_SMALL_PT)
    axes.axhline(0.5, color=_GREY, lw=0.6, ls=":")
    counts = " or ".join(map(str, sorted({own.people for own in numbers.values()})))
    axes.set(xlabel=f"Share of the variance (%), {counts} people", xlim=(0, 100))
    axes.xaxis.label.set(fontsize=_SMALL_PT)
    if len(numbers) > 1:
        figure.legend(loc="outside upper center", ncols=3, fontsize=7.5, handlelength=1.0)
    return figure


@styled
def paired_figure(
    first: ArrayLike, second: ArrayLike, conditions: tuple[str, str], label: str
) -> Figure:
    """Draw a line from the first to the second value (people,) of each person, and the medians.

    `label` is the quantity with its unit. Above stands the share of people with the same sign.
    """
    result, pairs = paired(first, second), np.column_stack([first, second]).astype(float)
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    figure = Figure(figsize=(_WIDTH, 3.0), layout="constrained")
    axes = figure.subplots()
    colours = {1: BLUE, -1: VERMILION, 0: _GREY}
    for pair in pairs:
        colour = colours[int(np.sign(pair[1] - pair[0]))]
        axes.plot([0, 1], pair, color=colour, lw=0.8, alpha=0.6, marker="o", ms=2.5, mew=0)
    axes.plot([0, 1], np.median(pairs, axis=0), color=INK, lw=2.2, marker="o", ms=5, zorder=3)
    axes.set(xticks=[0, 1], xlim=(-0.25, 1.25))
    axes.set_xticklabels(conditions)
    axes.set_ylabel(label)
    if pairs.min() >= 0:
        axes.set_ylim(bottom=0)
    way = {1: "higher", -1: "lower"}.get(int(np.sign(result.difference.value)), "equal")
    same = result.same
    axes.set_title(
        f"{way} in {100 * same.value:.0f} % of {result.people} people\n"
        f"(95 % interval {100 * same.low:.0f} to {100 * same.high:.0f} %)",
        fontsize=_SMALL_PT,
    )
    return figure
