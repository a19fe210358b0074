"""Figures of a scan: each function takes arrays and returns a matplotlib Figure.

An outline is an (n, 2) array of X, Y in mm: a closed curve on the stimulator at displacement 0.
The stimulator slides towards -Y, so at displacement d the receptor at Y = 0 passes the outline's
point at Y = d. The Y axis of an outline is therefore also the displacement.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curve
from numpy.typing import ArrayLike, NDArray

from tactile_fem.output.annotations import BLUE, GREEN, INK, VERMILION
from tactile_fem.output.histories import DISPLACEMENT, Outlines

PAPER = "#E6E3DC"
_FLAT_RATIO = 2.0  # maps that are longer than wide by this factor get flat figures
ACROSS = "Receptor position across the finger, X (mm)"
_STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "figure.dpi": 200,
}


def styled[**P](draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw in the package's style without changing the user's settings."""

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(_STYLE):
            return draw(*args, **kwargs)

    return styled


@styled
def raster_figure(
    spike_displacement_mm: ArrayLike,
    spike_x_mm: ArrayLike,
    rows_mm: ArrayLike,
    range_mm: tuple[float, float],
    outlines: Outlines = (),
    label: str = DISPLACEMENT,
    axis: str = "X",
) -> Figure:
    """Draw one dot for each spike (spikes,): X of its receptor over the displacement.

    The rows are X of all receptors, silent ones included; the range is that of the displacement.
    The label is that of the horizontal axis, which is drawn to scale if it ends in "(mm)" and may
    as well be "Time (s)"; in a section along the finger, the axis is "Y".
    """
    figure, axes = _map_axes(rows_mm, range_mm, label, axis)
    draw_outlines(axes, outlines)
    at, x = np.asarray(spike_displacement_mm, dtype=float), np.asarray(spike_x_mm, dtype=float)
    inside = (at >= range_mm[0] - 1e-9) & (at <= range_mm[1] + 1e-9)
    axes.plot(at[inside], x[inside], "o", ms=1.9, mew=0, color=INK, zorder=3, gid="spikes")
    return figure


@styled
def firing_figure(
    displacement_mm: ArrayLike,
    rows_mm: ArrayLike,
    rate_Hz: ArrayLike,
    outlines: Outlines = (),
    label: str = DISPLACEMENT,
    axis: str = "X",
) -> Figure:
    """Draw the firing rate (rows, columns) of a line of receptors as an image, outlines on top.

    Displacements (columns,) and X of the receptors (rows,) rise evenly. For `label` and `axis` see
    `raster_figure`.
    """
    d, x = np.asarray(displacement_mm, dtype=float), np.asarray(rows_mm, dtype=float)
    figure, axes = _map_axes(x, (d[0], d[-1]), label, axis)
    image = draw_rates(axes, d, x, np.asarray(rate_Hz), outlines)
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02, label="Firing rate (spikes/s)")
    bar.outline.set_visible(False)
    return figure


@styled
def force_figure(
    indentation: tuple[ArrayLike, str, ArrayLike],
    rest: tuple[ArrayLike, str, ArrayLike],
    friction: float | None = None,
    unit: str = "N",
    torques_Nmm: tuple[ArrayLike, ArrayLike] | None = None,
) -> Figure:
    """Draw normal and tangential force, their ratio and torques over indentation and slide.

    Both have an abscissa (steps,), its label, the forces on the finger (steps, 3), in a section
    per width, and a torque (steps,) if there are any. The ratio exceeds the coefficient of
    friction, drawn as a line, if inclined faces, such as the flanks of letters, push sideways; the
    legend then states this.
    """
    columns = []
    for along, label, force_N in (indentation, rest):
        x, y, normal = np.asarray(force_N, dtype=float).T
        columns.append((np.asarray(along, dtype=float), label, normal, np.hypot(x, y)))
    least = 1e-3 * max(normal.max(initial=1e-9) for _, _, normal, _ in columns)
    ratios = [
        np.divide(tangential, normal, out=np.full_like(normal, np.nan), where=normal > least)
        for _, _, normal, tangential in columns
    ]
    largest = np.nanmax(np.concatenate(ratios), initial=0.0)
    bound = "friction coefficient"
    if friction is not None and largest > friction + 0.01:
        bound += ", exceeded where flanks press sideways"
    further = 0 if torques_Nmm is None else 1
    figure = Figure(figsize=(7.0, 4.4 + 1.1 * further), layout="constrained")
    ratio = {"width_ratios": [1, 2], "height_ratios": [2, 1, *[1] * further]}
    grid = figure.subplots(2 + further, 2, sharex="col", sharey="row", gridspec_kw=ratio)
    for column, (along, label, normal, tangential) in enumerate(columns):
        top, below = grid[:2, column]
        top.plot(along, normal, color=BLUE, label="normal")
        top.plot(along, tangential, color=VERMILION, label="tangential")
        below.plot(along, ratios[column], color=INK, lw=1.2)
        if friction is not None:
            below.axhline(friction, color=GREEN, lw=1, ls=(0, (4, 3)), label=bound)
        grid[-1, column].set(xlabel=label, xlim=_span(along))
        if torques_Nmm is not None:
            grid[2, column].plot(along, np.asarray(torques_Nmm[column]), color=INK, lw=1.2)
    if torques_Nmm is not None:
        grid[2, 0].set_ylabel("Torque (Nmm)")
    grid[0, 0].set_ylabel(f"Force on the finger ({unit})")
    grid[0, 0].set_ylim(bottom=0)
    grid[1, 0].set_ylabel("Tangential / normal")
    grid[1, 0].set_ylim(0, 1.7 * max(friction or 0.0, largest, 1e-3))
    grid[0, 1].legend(loc="best")
    if friction is not None:
        grid[1, 1].legend(loc="upper right", fontsize=8)
    return figure


# --- parts of figures --------------------------------------------------------------------------


def _map_axes(
    rows_mm: ArrayLike, range_mm: tuple[float, float], label: str, axis: str
) -> tuple[Figure, Axes]:
    rows = np.asarray(rows_mm, dtype=float)
    margin = 0.3
    to_scale = label.endswith("(mm)")
    longer = np.ptp(range_mm) / (np.ptp(rows) + 2 * margin) if to_scale else 1.0
    size = (5.6, 5.2) if longer < _FLAT_RATIO else (9.5, 1.0 + 8.0 / longer)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.set_xlim(*_span(np.asarray(range_mm)))
    # X decreases upwards, so that letters that read along the scan are upright.
    ends = rows.max() + margin, rows.min() - margin
    axes.set_ylim(*(ends if axis == "X" else ends[::-1]))
    across = ACROSS if longer < _FLAT_RATIO and axis == "X" else f"{axis} (mm)"
    axes.set(xlabel=label, ylabel=across, aspect="equal" if to_scale else "auto")
    return figure, axes


def draw_outlines(axes: Axes, outlines: Outlines) -> None:
    """Fill the outlines; an outline inside another one is a hole."""
    curves = [Curve(np.vstack([o, o[:1]])[:, ::-1], closed=True) for o in outlines if len(o) > 2]
    if curves:
        curve = Curve.make_compound_path(*curves)
        axes.add_patch(PathPatch(curve, facecolor=PAPER, edgecolor="#B8B2A4", lw=0.7, zorder=0))


def draw_rates(
    axes: Axes,
    displacement_mm: NDArray[np.float64],
    rows_mm: NDArray[np.float64],
    rate_Hz: NDArray[np.float64],
    outlines: Outlines,
    brightest_Hz: float | None = None,
) -> QuadMesh:
    """Draw rates (rows, columns) as an image, colours starting at 0, and the outlines on top."""
    style = {"cmap": "cividis", "shading": "nearest", "rasterized": True}
    image = axes.pcolormesh(displacement_mm, rows_mm, rate_Hz, vmin=0, vmax=brightest_Hz, **style)
    for outline in outlines:
        closed = np.vstack([outline, outline[:1]])
        axes.plot(closed[:, 1], closed[:, 0], color="white", lw=0.8, alpha=0.8)
    return image


def _span(values: NDArray[np.float64]) -> tuple[float, float]:
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    return (low, high) if high > low else (low, low + 1.0)
