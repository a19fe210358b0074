"""Spikes and firing rates of a scan's populations over its whole path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, MaxNLocator
from numpy.typing import NDArray

from tactile_fem.neuron import Response
from tactile_fem.output.abscissa import Abscissa, inches
from tactile_fem.output.cross_section import CrossSectionMap, draw_outline
from tactile_fem.output.panels import legend_above, panels
from tactile_fem.output.plots import styled

Array = NDArray[np.float64]

# As many receptors that do not lie in a line get a row each; more become an image.
_MOST_ROWS = 40
_COLUMNS, _OUTLINE_COLUMNS, _OUTLINE_ROWS = 401, 900, 300
# Standard deviation of the Gaussian that spreads a spike.
_WINDOW_S = 0.01
_MARGIN_MM = 0.3
# Height of a panel that is not to scale, and the largest and least sizes of one that is.
_HEIGHT_INCHES, _TALLEST, _WIDEST, _NARROWEST = 3.2, 4.2, 8.5, 1.8
_WIDTH_INCHES, _PAGE_INCHES = 5.2, 8.4
_LINE_MM = 1e-9


class Trains(NamedTuple):
    """The spikes of a population: its colour, places (receptors, 3), and times of each receptor."""

    name: str
    colour: str
    places_mm: Array
    response: Response


@dataclass(frozen=True)
class Line:
    """Receptors on a line along X (axis 0) or Y (axis 1) have their place as row.

    `beside_mm` is where the line lies on the other axis.
    """

    axis: int
    beside_mm: float

    @classmethod
    def of(cls, places_mm: Array) -> Line | None:
        """Return the line on which receptors lie, None if they lie on none."""
        for axis in (0, 1):
            other = places_mm[:, 1 - axis]
            if np.ptp(other) < _LINE_MM:
                return cls(axis, round(float(other[0]), 9))
        return None

    def points(self, rows_mm: Array) -> Array:
        """Return the points (n, 2) of some rows."""
        points = np.full((len(rows_mm), 2), self.beside_mm)
        points[:, self.axis] = rows_mm
        return points

    def label(self) -> str:
        """Return the name of the rows."""
        what = "X (mm)" if self.axis == 0 else "Y (mm)"
        return f"Receptor position, {what}"

    def limits(self, rows_mm: Array) -> tuple[float, float]:
        """Return the limits of the rows; X decreases upwards, so that letters are upright."""
        low, high = float(rows_mm.min()) - _MARGIN_MM, float(rows_mm.max()) + _MARGIN_MM
        return (high, low) if self.axis == 0 else (low, high)


@styled
def raster(trains: Sequence[Trains], over: Abscissa, beneath: CrossSectionMap) -> Figure:
    """Draw the spikes of all populations over the path, one row for each receptor.

    Populations on the same line share a panel, in which their rows are their places and the
    outline of the stimulator lies behind them. Receptors that are spread over the skin have a panel
    of their own, in the order of X; many of them are an image of their firing rate.
    """
    lines: dict[Line, list[Trains]] = {}
    spread: list[Trains] = []
    for one in trains:
        line = Line.of(one.places_mm)
        spread.append(one) if line is None else lines.setdefault(line, []).append(one)
    sizes = [
        _size(over, np.concatenate([_rows(line, t) for t in own])) for line, own in lines.items()
    ]
    widths = [width for width, _ in sizes]
    width = max(widths) if widths and not spread else _WIDTH_INCHES
    heights = [height * min(1.0, width / own) for own, height in sizes]
    figure, axes = panels(
        [*heights, *[_HEIGHT_INCHES] * len(spread)],
        over,
        width,
        right=1.0 if spread else 0.2,
        top=0.6 if len(trains) > 1 else 0.45,
    )
    for one_axes, (line, own) in zip(axes, lines.items(), strict=False):
        _draw_line(one_axes, line, own, over, beneath)
    for one_axes, own in zip(axes[len(lines) :], spread, strict=True):
        _draw_spread(one_axes, own, over, named=len(trains) > 1)
    if lines and len(trains) > 1:
        legend_above(axes[: len(lines)])
    return figure


@styled
def firing(trains: Sequence[Trains], over: Abscissa, beneath: CrossSectionMap) -> Figure | None:
    """Draw the firing rates of each population's line of receptors as an image.

    Of receptors that are spread over the skin it is the row on Y = 0. None if there is no even line
    of three receptors or more.
    """
    shown = [row for row in map(_even_line, trains) if row is not None]
    if not shown:
        return None
    tallest = min(_TALLEST, _PAGE_INCHES / len(shown))
    sizes = [_size(over, _rows(line, one), tallest) for line, one in shown]
    width = max(width for width, _ in sizes)
    figure, axes = panels(
        [height * min(1.0, width / own) for own, height in sizes], over, width, right=1.0
    )
    times = over.columns_s(_COLUMNS)
    rates = [one.response.rate(times, _WINDOW_S).T for _, one in shown]
    brightest = max(float(rate.max()) for rate in rates) or 1.0
    for one_axes, (line, one), rate in zip(axes, shown, rates, strict=True):
        rows = _rows(line, one)
        _draw_rates(one_axes, over.at(times), rows, rate, brightest)
        _draw_outline(one_axes, line, rows, over, beneath, colour="white")
        one_axes.set_ylim(*line.limits(rows))
        one_axes.set_ylabel(
            line.label() if len(trains) == 1 else f"{one.name}, {'XY'[line.axis]} (mm)"
        )
    return figure


# --- panels --------------------------------------------------------------------------------------


def _draw_line(
    axes: Axes, line: Line, trains: Sequence[Trains], over: Abscissa, beneath: CrossSectionMap
) -> None:
    rows = np.concatenate([_rows(line, one) for one in trains])
    _draw_outline(axes, line, rows, over, beneath)
    apart = np.diff(np.unique(rows.round(9))).min(initial=1.0)
    shift = min(apart / (len(trains) + 1), 0.3)
    for k, one in enumerate(trains):
        _draw_spikes(axes, one, over, _rows(line, one) + shift * (k - (len(trains) - 1) / 2))
    axes.set_ylim(*line.limits(rows))
    axes.set_ylabel(line.label())


def _draw_spread(axes: Axes, one: Trains, over: Abscissa, *, named: bool) -> None:
    """Draw receptors in the order of X, then Y: dots, or the image of many receptors."""
    order = np.lexsort((one.places_mm[:, 1], one.places_mm[:, 0]))
    if len(order) > _MOST_ROWS:
        times = over.columns_s(_COLUMNS)
        rate = one.response.rate(times, _WINDOW_S).T[order]
        _draw_rates(axes, over.at(times), np.arange(len(order)), rate)
    else:
        _draw_spikes(axes, one, over, np.argsort(order))
    x = one.places_mm[order, 0]
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(x[0], x[-1])
    ticks = ticks[(ticks >= x[0] - 1e-9) & (ticks <= x[-1] + 1e-9)]
    sides = [np.searchsorted(x, ticks + shift) for shift in (-1e-9, 1e-9)]
    axes.set_yticks((sides[0] + sides[1] - 1) / 2, list(map(_minus, ticks)))
    axes.set_ylim(len(order) - 0.5, -0.5)
    who = f"{one.name}, {len(order)} receptors" if named else f"{len(order)} receptors"
    axes.set_ylabel(f"{who} by X (mm), then Y")


def _draw_spikes(axes: Axes, one: Trains, over: Abscissa, rows: Array) -> None:
    """Draw a dot for each spike of receptors at places (receptors,) of the panel."""
    receptor, time_s = one.response.events()
    style = {"ls": "", "marker": "o", "ms": 2.2, "mew": 0, "zorder": 3, "gid": "spikes"}
    axes.plot(over.at(time_s), rows[receptor], color=one.colour, label=one.name, **style)


def _draw_outline(
    axes: Axes,
    line: Line,
    rows: Array,
    over: Abscissa,
    beneath: CrossSectionMap,
    colour: str | None = None,
) -> None:
    fine = np.linspace(rows.min() - _MARGIN_MM, rows.max() + _MARGIN_MM, _OUTLINE_ROWS)
    times = over.columns_s(_OUTLINE_COLUMNS)
    inside = beneath.under(line.points(fine), times)
    draw_outline(axes, over.at(times), fine, inside, colour=colour)


def _draw_rates(
    axes: Axes, at: Array, rows: Array, rate_Hz: Array, brightest_Hz: float | None = None
) -> None:
    """Draw rates (rows, columns) as an image with its colour bar, whose colours start at 0."""
    style = {"cmap": "cividis", "shading": "nearest", "rasterized": True}
    image = axes.pcolormesh(at, rows, rate_Hz, vmin=0, vmax=brightest_Hz, **style)
    figure = axes.get_figure(root=True)
    place = axes.inset_axes((1.02, 0.05, 0.16 / inches(axes)[0], 0.9))
    bar = figure.colorbar(image, cax=place, label="Firing rate (spikes/s)")
    bar.outline.set_visible(False)


def _minus(tick: float) -> str:
    return Formatter.fix_minus(f"{tick:g}")


def _rows(line: Line, one: Trains) -> Array:
    return one.places_mm[:, line.axis]


def _even_line(one: Trains) -> tuple[Line, Trains] | None:
    """Return a population's receptors on a line, or on Y = 0, by rising place, if it is even."""
    line = Line.of(one.places_mm) or Line(0, 0.0)
    beside = np.abs(one.places_mm[:, 1 - line.axis] - line.beside_mm) < _LINE_MM
    chosen = np.flatnonzero(beside)
    chosen = chosen[np.argsort(one.places_mm[chosen, line.axis])]
    rows = one.places_mm[chosen, line.axis]
    steps = np.diff(rows)
    if len(rows) < 3 or not np.allclose(steps, steps[0]):
        return None
    response = Response(
        [one.response.spikes[k] for k in chosen], one.response.start_s, one.response.end_s
    )
    return line, Trains(one.name, one.colour, one.places_mm[chosen], response)


def _size(over: Abscissa, rows: Array, tallest: float = _TALLEST) -> tuple[float, float]:
    """Return width and height in inches: to scale if rows and axis are lengths and it fits."""
    across, along = float(np.ptp(rows)) + 2 * _MARGIN_MM, float(np.ptp(over.ends))
    if over.is_to_scale and along > 0:
        width = min(_WIDEST, tallest * along / across)
        if width >= _NARROWEST:
            return width, width * across / along
    height = min(_HEIGHT_INCHES, tallest)
    return _WIDTH_INCHES, height if across > 2 * _MARGIN_MM else height / 2
