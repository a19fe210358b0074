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
    parts = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    rates = [np.array([one.response.mean_rate(*part) for part in parts]) for one in spread]
    scale = Normalize(0.0, max(float(rate.max()) for rate in rates) or 1.0)
    columns = _MAPS if page_inches() > _LEAST_INCHES else _MAPS // 2
    wide = min(_MAP_INCHES, (page_inches() - _BESIDE_INCHES) / columns)
    rows = len(spread) * _MAPS // columns
    sides_mm = [np.ptp(one.places_mm[:, :2], axis=0) + 2 * _MARGIN_MM for one in spread]
    high = _ABOVE_INCHES + wide * max(np.divide(*sides) for sides in sides_mm)
    size = _BESIDE_INCHES + columns * wide, rows * high
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for maps, one, rate in zip(grid.reshape(len(spread), _MAPS), spread, rates, strict=True):
        for k, (axes, (start_s, end_s)) in enumerate(zip(maps, parts, strict=True)):
            _draw_map(axes, one, rate[k], scale, wide)
            middle_s = (start_s + end_s) / 2
            _draw_outline(axes, beneath, middle_s)
            names = [of.name for of in over.phases if of.start <= over.at(middle_s) <= of.end]
            name = f"{names[0]}\n" if names else ""
            part = Formatter.fix_minus(f"{1000 * start_s:.0f} to {1000 * end_s:.0f} ms")
            axes.set_title(name + part, fontsize=7.5)
            axes.tick_params(labelleft=k % columns == 0)
        maps[0].set_xlabel("Y (mm)", fontsize=7.5)
        maps[0].set_ylabel(f"{one.name}, X (mm)" if len(trains) > 1 else "X (mm)", fontsize=7.5)
    style = {"shrink": 0.9, "pad": 0.01, "aspect": 8 * size[1], "label": "Spikes/s"}
    bar = figure.colorbar(ScalarMappable(scale, _SCALE), ax=grid, **style)
    bar.outline.set_visible(False)
    return figure


def _draw_map(axes: Axes, one: Trains, rate: np.ndarray, scale: Normalize, wide: float) -> None:
    places = one.places_mm[:, :2]
    low, high = places.min(axis=0) - _MARGIN_MM, places.max(axis=0) + _MARGIN_MM
    apart = np.median(cKDTree(places).query(places, 2)[0][:, 1])
    point = 72 * 0.8 * wide / (high - low)[1]
    dots = {"s": (0.9 * apart * point) ** 2, "marker": "s", "linewidths": 0}
    axes.scatter(places[:, 1], places[:, 0], c=rate, cmap=_SCALE, norm=scale, **dots)
    axes.set(xlim=(low[1], high[1]), ylim=(high[0], low[0]), aspect="equal")  # letters are upright
    axes.tick_params(labelsize=7)


def _draw_outline(axes: Axes, beneath: CrossSectionMap, time_s: float) -> None:
    y = np.linspace(*axes.get_xlim(), _FINE)
    x = np.linspace(*sorted(axes.get_ylim()), _FINE)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    inside = beneath.under(points, np.array([time_s])).reshape(_FINE, _FINE)
    draw_outline(axes, y, x, inside, colour=VERMILION)
