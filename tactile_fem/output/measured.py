"""The figure and the table of a scan beside a recording."""

from __future__ import annotations

import logging

from matplotlib.figure import Figure

from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import BLUE, INK
from tactile_fem.output.panels import legend_above, panels
from tactile_fem.output.plots import styled
from tactile_fem.results.measured import compare
from tactile_fem.results.results import Results
from tactile_fem.runtime.files import write_table

logger = logging.getLogger(__name__)

_WIDTH, _HEIGHT = 4.6, 1.4  # inches
_WORDS = {"r": "turn about ", "f": "force ", "t": "torque about "}


@styled
def measured(results: Results, over: Abscissa) -> Figure | None:
    """Draw what was recorded and what the model gave, one panel for each column; None without.

    Log the differences and write ``measured.csv``.
    """
    found = compare(results.study, results.trace)
    if not found:
        return None
    table = {"time_s": found[0].time_s}
    figure, all_axes = panels([_HEIGHT] * len(found), over, _WIDTH, top=0.6)
    for one, axes in zip(found, all_axes, strict=True):
        table |= {one.name: one.recorded, f"model_{one.name}": one.model}
        logger.info("%s: %s", one.name, one.summary)
        at = over.at(one.time_s)
        axes.plot(at, one.recorded, color=INK, lw=2.4, alpha=0.4, label="recorded")
        axes.plot(at, one.model, color=BLUE, lw=1.2, label="model")
        quantity, _, unit = one.name.partition("_")
        words = _WORDS.get(quantity[:-1], "") + quantity[-1].upper()
        axes.set_ylabel(f"{words[0].upper()}{words[1:]} ({unit})")
        axes.margins(y=0.25)
        style = {"ha": "right", "va": "top", "fontsize": 7.5}
        axes.text(0.99, 0.98, one.summary, transform=axes.transAxes, **style)
    legend_above(all_axes[:1])
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    write_table(results.folder / "measured.csv", rows)
    return figure
