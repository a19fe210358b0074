"""Spikes and firing rates of populations over the whole path of a scan, or over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response
from tactile_fem.output.abscissa import Abscissa, inches
from tactile_fem.output.annotations import colours_of
from tactile_fem.output.cross_section import CrossSectionMap, draw_outline
from tactile_fem.output.panels import LEFT, legend_above, panels
from tactile_fem.output.plots import printed, styled
from tactile_fem.results.histories import TIME

Array = NDArray[np.float64]

Spikes = Response | Mapping[str, Response]

# As many receptors that do not lie in a line get a row each; more become an image. As many
# populations on the same line share a panel.
_MOST_ROWS, _MOST_SHARED = 200, 2
_COLUMNS, _OUTLINE_COLUMNS, _OUTLINE_ROWS = 401, 900, 300
# Standard deviation of the Gaussian that spreads a spike.
_WINDOW_S = 0.01
# The brightest colour is that of this percentile of the rates above 0, which few afferents exceed.
_BRIGHTEST_PERCENT = 99.0
_MARGIN_MM = 0.3
# Height of a panel that is not to scale, and the largest and least sizes of one that is.
_HEIGHT_INCHES, _TALLEST, _WIDEST, _NARROWEST = 3.2, 4.2, 8.5, 1.3
# Of one of several panels, of a row of spikes, and beside a colour bar.
_LOW_INCHES, _ROW_INCHES, _RIGHT_INCHES = 1.42, 0.02, 0.8
_WIDTH_INCHES = 5.2
_LINE_MM, _LEAST_BAND = 1e-9, 0.15  # share of all bands


class Trains(NamedTuple):
    """The spikes of a population: its colour, places (receptors, 3), and times of each receptor."""

    name: str
    colour: str
    places_mm: Array
    response: Response

    @property
    def order(self) -> NDArray[np.intp]:
        """The receptors in the order of X, then Y, (receptors,)."""
        return np.lexsort((self.places_mm[:, 1], self.places_mm[:, 0]))


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

    def label(self, name: str) -> str:
        """Return the name of the rows."""
        return f"{name or 'Receptor position'}, {'XY'[self.axis]} (mm)"

    def limits(self, rows_mm: Array) -> tuple[float, float]:
        """Return the limits of the rows; X decreases upwards, so that letters are upright."""
        low, high = float(rows_mm.min()) - _MARGIN_MM, float(rows_mm.max()) + _MARGIN_MM
        return (high, low) if self.axis == 0 else (low, high)


@printed
def draw_raster(spikes: Spikes, by: ArrayLike = (), *, width_mm: float = 85.0) -> Figure:
    """Draw a dot for each spike over time: a row for each afferent, a band for each class.

    Parameters
    ----------
    spikes
        A response, or responses by the names of their classes.
    by
        Class of each afferent of a response, as ``trace["population"]``; default: all are one.
    width_mm
        Of the figure, whose text has 7 points.

    Raises
    ------
    StudyError
        There are not as many classes as afferents, or no responses.
    """
    trains, over = trains_by(spikes, by)
    figure, (axes,) = _page([_height_of_bands(trains)], over, width_mm)
    _draw_bands(axes, trains, over)
    return figure


@printed
def draw_psth(
    spikes: Spikes, by: ArrayLike = (), *, bin_s: float = 0.01, width_mm: float = 85.0
) -> Figure:
    """Draw the mean rate of each class in bins of `bin_s`; otherwise as `draw_raster`."""
    trains, over = trains_by(spikes, by)
    figure, (axes,) = _page([0.016 * width_mm], over, width_mm, top=0.4)
    for one in trains:
        edges_s, counts = one.response.psth(bin_s)
        edges_s[-1] = min(edges_s[-1], one.response.end_s)
        rate_Hz = counts.mean(axis=1) / np.diff(edges_s)
        axes.stairs(rate_Hz, edges_s, color=one.colour, label=one.name)
    axes.set(ylim=(0, None), ylabel="Spikes/s per afferent")
    if len(trains) > 1:
        legend_above([axes])
    return figure


@printed
def draw_rates(spikes: Spikes, by: ArrayLike = (), *, width_mm: float = 85.0) -> Figure:
    """Draw the rates of afferents, a panel for each class; otherwise as `draw_raster`."""
    trains, over = trains_by(spikes, by)
    heights = [0.009 * width_mm] * len(trains)
    figure, all_axes = _page(heights, over, width_mm, right=_RIGHT_INCHES)
    _draw_rates(all_axes, trains, [np.arange(len(one.places_mm)) for one in trains], over)
    for axes, one in zip(all_axes, trains, strict=True):
        axes.set_ylabel(f"{one.name}, afferent")
        axes.invert_yaxis()
    return figure


def _page(
    heights: Sequence[float], over: Abscissa, width_mm: float, right: float = 0.18, top: float = 0.1
) -> tuple[Figure, list[Axes]]:
    return panels(heights, over, width_mm / 25.4 - LEFT - right, right=right, top=top)


def trains_by(spikes: Spikes, by: ArrayLike = ()) -> tuple[list[Trains], Abscissa]:
    """Return the trains of each class, without places, and their time; see `draw_raster`."""
    if isinstance(spikes, Response):
        count, names = len(spikes.spikes), np.asarray(by, dtype=str)
        if names.shape not in ((0,), (count,)):
            raise StudyError(f"by has shape {names.shape}; it needs ({count},), a class for each.")
        names = names if names.size else np.full(count, "afferents")
        spikes = {name: spikes.of(names == name) for name in dict.fromkeys(names.tolist())}
    if not spikes:
        raise StudyError("spikes has no responses; it needs one or more.")
    trains = [
        Trains(name, colour, np.full((len(spikes[name].spikes), 3), np.nan), spikes[name])
        for name, colour in colours_of(spikes).items()
    ]
    start = min(one.response.start_s for one in trains)
    end = max(one.response.end_s for one in trains)
    return trains, Abscissa(TIME, 1.0, np.array([start, end]), ())


@styled
def raster(trains: Sequence[Trains], over: Abscissa, beneath: CrossSectionMap) -> Figure:
    """Draw the spikes of all populations over the path, one row for each receptor.

    Two populations on the same line share a panel, in which their rows are their places and the
    outline of the stimulator lies behind them; more have a panel each. Receptors that are spread
    over the skin are in the order of X, in a band for each population; very many of a single one
    are an image of their firing rate.
    """
    lines: dict[tuple[Line, str], list[Trains]] = {}
    at = [Line.of(one.places_mm) for one in trains]
    spread = [one for one, line in zip(trains, at, strict=True) if line is None]
    for one, line in zip(trains, at, strict=True):
        if line is not None:
            name = one.name if at.count(line) > _MOST_SHARED else ""
            lines.setdefault((line, name), []).append(one)
    rows = [np.concatenate([_rows(line, t) for t in own]) for (line, _), own in lines.items()]
    width, heights = _sizes(over, rows, _WIDTH_INCHES if spread else None)
    if spread:
        heights.append(_height_of_bands(spread) if len(spread) > 1 else _HEIGHT_INCHES)
    are_shared = len(lines) + len(spread) < len(trains)
    right, top = 1.0 if spread else 0.2, 0.6 if are_shared else 0.45
    figure, axes = panels(heights, over, width, right=right, top=top)
    for one_axes, ((line, name), own) in zip(axes, lines.items(), strict=False):
        _draw_line(one_axes, line, own, over, beneath)
        one_axes.set_ylabel(line.label(name))
    if len(spread) == 1:
        _draw_spread(axes[-1], spread[0], over, named=len(trains) > 1)
    elif spread:
        _draw_bands(axes[-1], spread, over)
    if are_shared:
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
    rows = [_rows(line, one) for line, one in shown]
    width, heights = _sizes(over, rows)
    figure, axes = panels(heights, over, width, right=_RIGHT_INCHES)
    _draw_rates(axes, [one for _, one in shown], rows, over)
    for one_axes, (line, one), own in zip(axes, shown, rows, strict=True):
        _draw_outline(one_axes, line, own, over, beneath, colour="white")
        one_axes.set_ylim(*line.limits(own))
        one_axes.set_ylabel(line.label(one.name if len(trains) > 1 else ""))
    return figure


# --- panels --------------------------------------------------------------------------------------


def _draw_line(
    axes: Axes, line: Line, trains: Sequence[Trains], over: Abscissa, beneath: CrossSectionMap
) -> None:
    rows = np.concatenate([_rows(line, one) for one in trains])
    _draw_outline(axes, line, rows, over, beneath)
    axes.set_ylim(*line.limits(rows))
    shift = min(_apart(rows) / (len(trains) + 1), 0.3)
    for k, one in enumerate(trains):
        _draw_spikes(axes, one, over, _rows(line, one) + shift * (k - (len(trains) - 1) / 2))


def _height_of_bands(trains: Sequence[Trains]) -> float:
    count = sum(len(one.response.spikes) for one in trains)
    return float(np.clip(_ROW_INCHES * count, 0.3 * len(trains) + 0.2, _HEIGHT_INCHES))


def _draw_bands(axes: Axes, trains: Sequence[Trains], over: Abscissa) -> None:
    """Draw a band for each population, with its receptors in the order of X, then Y."""
    counts = [len(one.response.spikes) for one in trains]
    ends = np.cumsum([0.0, *np.maximum(counts, _LEAST_BAND * sum(counts))])
    axes.set_ylim(ends[-1], 0.0)
    middles, names = (ends[1:] + ends[:-1]) / 2, []
    for one, count, middle, band in zip(trains, counts, middles, np.diff(ends), strict=True):
        axes.axhspan(middle - band / 2, middle + band / 2, color=one.colour, alpha=0.1, lw=0)
        _draw_spikes(axes, one, over, middle - (count - 1) / 2 + np.argsort(one.order))
        names.append(f"{one.name}: {count}\n{one.response.counts().sum()} spikes")
    for label, one in zip(axes.set_yticks(middles, names), trains, strict=True):
        label.label1.set_color(one.colour)
    axes.tick_params(axis="y", length=0)


def _draw_spread(axes: Axes, one: Trains, over: Abscissa, *, named: bool) -> None:
    """Draw receptors in the order of X, then Y: dots, or the image of very many receptors."""
    order = one.order
    count, x = len(order), one.places_mm[order, 0]
    axes.set_ylim(count - 0.5, -0.5)
    if count > _MOST_ROWS:
        ordered = one._replace(response=one.response.of(order))
        _draw_rates([axes], [ordered], [np.arange(count)], over)
    else:
        _draw_spikes(axes, one, over, np.argsort(order))
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(x[0], x[-1])
    ticks = ticks[(ticks >= x[0] - 1e-9) & (ticks <= x[-1] + 1e-9)]
    sides = [np.searchsorted(x, ticks + shift) for shift in (-1e-9, 1e-9)]
    axes.set_yticks((sides[0] + sides[1] - 1) / 2, [Formatter.fix_minus(f"{x:g}") for x in ticks])
    who = f"{one.name}, " if named else ""
    axes.set_ylabel(f"{who}{count} receptors by X (mm), then Y")


def _draw_spikes(axes: Axes, one: Trains, over: Abscissa, rows: Array) -> None:
    """Draw a dot for each spike of receptors at places (receptors,) of the panel."""
    receptor, time_s = one.response.events()
    row_pt = 72 * inches(axes)[1] / abs(np.subtract(*axes.get_ylim())) * _apart(rows)
    style = {"color": one.colour, "label": one.name, "ms": np.clip(row_pt, 0.7, 2.2)}
    draw_spikes(axes, over.at(time_s), rows[receptor], **style)


def _apart(rows: Array) -> float:
    """Return the least distance of rows, 1 if there is one."""
    return float(np.diff(np.unique(rows.round(9))).min(initial=1.0))


def draw_spikes(axes: Axes, at: ArrayLike, rows: ArrayLike, **style: Any) -> None:
    """Draw a dot for each spike at `at` (spikes,) of the axis in `rows` (spikes,)."""
    dots = {"ls": "", "marker": "o", "ms": 2.2, "mew": 0, "zorder": 3, "gid": "spikes"}
    axes.plot(at, rows, **(dots | style))


def _draw_outline(
    axes: Axes,
    line: Line,
    rows: Array,
    over: Abscissa,
    beneath: CrossSectionMap,
    colour: str | None = None,
) -> None:
    fine = np.linspace(rows.min() - _MARGIN_MM, rows.max() + _MARGIN_MM, _OUTLINE_ROWS)
    points = np.full((len(fine), 2), line.beside_mm)
    points[:, line.axis] = fine
    times = over.columns_s(_OUTLINE_COLUMNS)
    draw_outline(axes, over.at(times), fine, beneath.under(points, times), colour=colour)


def _draw_rates(
    all_axes: Sequence[Axes], trains: Sequence[Trains], rows: Sequence[Any], over: Abscissa
) -> None:
    """Draw rates as images over rows (receptors,), with one scale and the bar beside the first."""
    times = over.columns_s(_COLUMNS)
    rates = [one.response.rate(times, _WINDOW_S).T for one in trains]
    every = np.concatenate([rate.ravel() for rate in rates])
    brightest = np.percentile(every[every > 0], _BRIGHTEST_PERCENT) if every.any() else 1.0
    scale = Normalize(0.0, float(brightest))
    for axes, own, rate in zip(all_axes, rows, rates, strict=True):
        style = {"cmap": "cividis", "shading": "nearest", "rasterized": True}
        axes.pcolormesh(over.at(times), own, rate, norm=scale, **style)
    figure, box = all_axes[0].get_figure(root=True), all_axes[0].get_position()
    inch = 1 / figure.get_figwidth()
    place = box.x1 + 0.1 * inch, box.y0, 0.13 * inch, box.height
    extend = "max" if every.max(initial=0.0) > brightest else "neither"
    scale, cax = ScalarMappable(scale, "cividis"), figure.add_axes(place)
    bar = figure.colorbar(scale, cax=cax, extend=extend, label="Rate (spikes/s)")
    bar.outline.set_visible(False)


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
    return line, one._replace(places_mm=one.places_mm[chosen], response=one.response.of(chosen))


def _sizes(
    over: Abscissa, rows: Sequence[Array], width: float | None = None
) -> tuple[float, list[float]]:
    """Return the width, the largest by default, and the heights of panels of such rows, inches."""
    tallest = _TALLEST if len(rows) <= _MOST_SHARED else _LOW_INCHES
    sizes = [_size(over, own, tallest) for own in rows]
    width = width or max(own for own, _ in sizes)
    return width, [height * min(1.0, width / own) for own, height in sizes]


def _size(over: Abscissa, rows: Array, tallest: float) -> tuple[float, float]:
    """Return width and height in inches: to scale if rows and axis are lengths and it fits."""
    across, along = float(np.ptp(rows)) + 2 * _MARGIN_MM, float(np.ptp(over.ends))
    if over.is_to_scale and along > 0:
        width = min(_WIDEST, tallest * along / across)
        if width >= _NARROWEST:
            return width, width * across / along
    height = min(_HEIGHT_INCHES, tallest)
    return _WIDTH_INCHES, height if across > 2 * _MARGIN_MM else height / 2
