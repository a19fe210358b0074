"""Firing of receptors spread over the skin, as maps at successive times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter
from scipy.spatial import cKDTree

from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import VERMILION
from tactile_fem.output.cross_section import CrossSectionMap, draw_outline
from tactile_fem.output.panels import page_inches
from tactile_fem.output.plots import styled
from tactile_fem.output.rasters import Line, Trains

_MAPS, _FINE = 6, 160
_MAP_INCHES, _MARGIN_MM = 1.5, 0.4
# On a narrower page maps are in two rows.
_LEAST_INCHES = 7.0
# Beside all maps, and above and below each.
_BESIDE_INCHES, _ABOVE_INCHES = 0.8, 0.75
_SCALE = "cividis"


@styled
def snapshots(trains: Sequence[Trains], over: Abscissa, beneath: CrossSectionMap) -> Figure | None:
    """Draw the rates of receptors that do not lie in a line, in equal parts of the path's time.

    Each population has a row of maps, with Y to the right as letters read, and the outline of the
    stimulator in the middle of each part. None if all receptors lie in lines.
    """
    spread = [one for one in trains if Line.of(one.places_mm) is None]
    if not spread:
        return None
    edges = over.columns_s(_MAPS + 1)
    rates = [
        np.array([one.response.mean_rate(*edges[k : k + 2].tolist()) for k in range(_MAPS)])
        for one in spread
    ]
    scale = Normalize(0.0, max(float(rate.max()) for rate in rates) or 1.0)
    columns = _MAPS if page_inches() > _LEAST_INCHES else _MAPS // 2
    wide = min(_MAP_INCHES, (page_inches() - _BESIDE_INCHES) / columns)
    rows = len(spread) * _MAPS // columns
    high = _ABOVE_INCHES + wide * max(np.divide(*_sides_mm(one)) for one in spread)
    size = _BESIDE_INCHES + columns * wide, rows * high
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for maps, one, rate in zip(grid.reshape(len(spread), _MAPS), spread, rates, strict=True):
        for k, axes in enumerate(maps):
            _draw_map(axes, one, rate[k], scale, wide)
            _draw_outline(axes, beneath, float(edges[k : k + 2].mean()))
            axes.set_title(f"{_phase(over, edges[k : k + 2].mean())}{_interval(*edges[k : k + 2])}")
            axes.tick_params(labelleft=k % columns == 0)
        name = f"{one.name}, " if len(trains) > 1 else ""
        maps[0].set(xlabel="Y (mm)", ylabel=f"{name}X (mm)")
    for axes in grid.flat:
        for text in (axes.title, axes.xaxis.label, axes.yaxis.label):
            text.set_fontsize(7.5)
    style = {"shrink": 0.9, "pad": 0.01, "aspect": 8 * size[1], "label": "Spikes/s"}
    bar = figure.colorbar(ScalarMappable(scale, _SCALE), ax=grid, **style)
    bar.outline.set_visible(False)
    return figure


def _sides_mm(one: Trains) -> np.ndarray:
    """Return how far receptors are spread in X and in Y, with a margin."""
    return np.ptp(one.places_mm[:, :2], axis=0) + 2 * _MARGIN_MM


def _draw_map(axes: Axes, one: Trains, rate: np.ndarray, scale: Normalize, wide: float) -> None:
    x, y = one.places_mm[:, 0], one.places_mm[:, 1]
    low, high = (np.array(ends) for ends in ((x.min(), y.min()), (x.max(), y.max())))
    apart = np.median(cKDTree(one.places_mm[:, :2]).query(one.places_mm[:, :2], 2)[0][:, 1])
    point = 72 * 0.8 * wide / _sides_mm(one)[1]
    dots = {"s": (0.9 * apart * point) ** 2, "marker": "s", "linewidths": 0}
    axes.scatter(y, x, c=rate, cmap=_SCALE, norm=scale, **dots)
    axes.set(xlim=(low[1] - _MARGIN_MM, high[1] + _MARGIN_MM), aspect="equal")
    axes.set_ylim(high[0] + _MARGIN_MM, low[0] - _MARGIN_MM)  # letters are upright
    axes.tick_params(labelsize=7)


def _draw_outline(axes: Axes, beneath: CrossSectionMap, time_s: float) -> None:
    y = np.linspace(*axes.get_xlim(), _FINE)
    x = np.linspace(*sorted(axes.get_ylim()), _FINE)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    inside = beneath.under(points, np.array([time_s])).reshape(_FINE, _FINE)
    draw_outline(axes, y, x, inside, colour=VERMILION)


def _phase(over: Abscissa, time_s: float) -> str:
    names = [phase.name for phase in over.phases if phase.start <= over.at(time_s) <= phase.end]
    return f"{names[0]}\n" if names else ""


def _interval(start_s: float, end_s: float) -> str:
    return Formatter.fix_minus(f"{1000 * start_s:.0f} to {1000 * end_s:.0f} ms")
