"""Figures of panels one below the other, over the axis of a scan, of sizes that are exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem.output.abscissa import Abscissa, inches
from tactile_fem.output.annotations import ShownFigure
from tactile_fem.runtime.files import in_print

LEFT, _GAP = 0.9, 0.15  # inches


def page_inches() -> float:
    """Return the width that a figure may have."""
    return in_print.get().layout((np.inf, np.inf), 1.0)[0][0]


def panels(
    heights: Sequence[float],
    over: Abscissa,
    width: float,
    *,
    right: float = 0.2,
    top: float = 0.45,
    below: float = 0.0,
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels; their heights and width and the margins are in inches.

    All panels are made smaller if the page is not as wide.

    Phases are named above the first panel; the axis is labelled below the last one, and below its
    labels there is room for more.
    """
    share = min(1.0, (page_inches() - LEFT - right) / width)
    heights, width = [share * height for height in heights], share * width
    bottom = (1.0 if over.is_to_scale else 0.5) + below
    inner = sum(heights) + _GAP * (len(heights) - 1)
    size = LEFT + width + right, bottom + inner + top
    figure, found, low = ShownFigure(figsize=size), list[Axes](), size[1] - top + _GAP
    for k, height in enumerate(heights):
        low -= height + _GAP
        box = LEFT / size[0], low / size[1], width / size[0], height / size[1]
        axes, last = figure.add_axes(box), k == len(heights) - 1
        over.draw(axes, names=k == 0, label=last)
        axes.tick_params(labelbottom=last)
        axes.yaxis.set_label_coords(-0.52 / width, 0.5)  # aligned, independent of the tick labels
        found.append(axes)
    return figure, found


def legend_above(all_axes: Sequence[Axes]) -> None:
    """Draw one legend for all panels at the upper right, above the names of the phases."""
    handles = [one for axes in all_axes for one in axes.get_legend_handles_labels()[0]]
    first = all_axes[0]
    place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0 + 0.2 / inches(first)[1])}
    style = {"handletextpad": 0.4, "borderpad": 0, "fontsize": 8, "markerscale": 2.0}
    first.legend(handles=handles, ncols=len(handles), **place, **style)
