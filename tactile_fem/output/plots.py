"""The style of all figures, and the figure of a scan's forces."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import BLUE, GREEN, INK, VERMILION
from tactile_fem.output.panels import page_inches
from tactile_fem.path.rotations import moment_about

_LETTERS_PER_INCH = 9  # of a legend, of the whole width
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

# Draws in the package's style without changing the user's settings.
styled = mpl.rc_context(_STYLE)
# Likewise at the size of print, a column being 85 mm wide.
printed = mpl.rc_context(_STYLE | {"font.size": 7, "lines.linewidth": 1.0, "figure.dpi": 300})


@styled
def force_figure(
    trace: Mapping[str, NDArray[Any]],
    over: Abscissa,
    friction: float | None = None,
    unit: str = "N",
) -> Figure:
    """Draw normal and tangential force, and their ratio, over the indentation and over the path.

    Without an indentation, as of a path that is followed, there is only the latter. Of a body that
    twists, its torque about its own axis follows. The ratio exceeds the coefficient of friction,
    drawn as a line, if inclined faces, such as the flanks of letters, push sideways; the legend
    then states this. The `unit` is that of the forces.
    """
    x, y, normal = trace["force_N"].T
    tangential, ratio = np.hypot(x, y), np.full(len(normal), np.nan)
    np.divide(tangential, normal, out=ratio, where=normal > 1e-3 * max(normal.max(), 1e-9))
    largest, bound = np.nanmax(ratio, initial=0.0), "friction coefficient"
    if friction is not None and largest > friction + 0.01:
        bound += ", exceeded where flanks press sideways"
    panels = [[(normal, BLUE, "normal"), (tangential, VERMILION, "tangential")], [(ratio, INK, "")]]
    if trace["stimulator_rad"][:, 2].any():
        about = trace["stimulator_mm"], trace["force_N"], trace["moment_Nmm"]
        panels.append([(moment_about(*about)[:, 2], INK, "")])
    size = min(7.0, page_inches()), 2.2 + 1.1 * len(panels)
    bound = textwrap.fill(bound, int(_LETTERS_PER_INCH * size[0]))
    figure = Figure(figsize=size, layout="constrained")
    pressed = np.flatnonzero(trace["time_s"] <= 1e-12)
    columns = [(trace["depth_mm"], pressed), (over.values, slice(None))]
    if len(pressed) == 1 < len(trace["time_s"]):
        del columns[0]
    high, wide = [2, 1, 1][: len(panels)], [1, 2][-len(columns) :]
    style = {"sharex": "col", "sharey": "row", "height_ratios": high, "width_ratios": wide}
    grid = figure.subplots(len(panels), len(columns), squeeze=False, **style)
    for (at, rows), all_axes in zip(columns, grid.T, strict=True):
        for axes, histories in zip(all_axes, panels, strict=True):
            for values, colour, label in histories:
                style = {"color": colour, "label": label, "lw": 1.6 if label else 1.2}
                axes.plot(at[rows], values[rows], **style)
        if friction is not None:
            all_axes[1].axhline(friction, color=GREEN, lw=1, ls=(0, (4, 3)), label=bound)
    if len(columns) > 1:
        grid[-1, 0].set_xlabel("Indentation (mm)")
    for axes in grid[:, -1]:
        over.draw(axes, names=axes is grid[0, -1], label=axes is grid[-1, -1])
    labels = f"Force on the finger ({unit})", "Tangential /\nnormal", "Torque (Nmm)"
    for axes, label in zip(grid[:, 0], labels, strict=False):
        axes.set_ylabel(label)
        axes.margins(x=0)
    grid[0, 0].set_ylim(bottom=0)
    grid[1, 0].set_ylim(0, 1.7 * max(friction or 0.0, largest, 1e-3))
    grid[0, -1].legend(loc="best")
    if friction is not None:
        grid[1, -1].legend(loc="upper right", fontsize=8).set_in_layout(False)
    return figure
