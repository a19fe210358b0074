"""The style of all figures, and the figure of a scan's forces."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from tactile_fem.output.annotations import BLUE, GREEN, INK, VERMILION

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


def _span(values: NDArray[np.float64]) -> tuple[float, float]:
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    return (low, high) if high > low else (low, low + 1.0)
