"""Scans side by side: histories on common axes, and numbers with differences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.textpath import TextPath
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from tactile_fem.output.abscissa import Abscissa, inches
from tactile_fem.output.annotations import DISTINCT
from tactile_fem.output.panels import panels
from tactile_fem.output.plots import styled
from tactile_fem.results.histories import TIME, central_receptor
from tactile_fem.results.numbers import history, numbers_of
from tactile_fem.results.results import Results
from tactile_fem.runtime.files import write_figure

Array = NDArray[np.float64]

# Of the numbers of a scan, see `numbers_of`: those that are compared, and their headings.
_COMPARED = {
    "pressed_": "Pressed",
    "normal_": "Normal",
    "tangential_": "Tangential",
    "central_largest_sed_": "Central SED",
}
_SPIKES = "spikes_"
_UNITS = {"N_per_mm": "N/mm", "kPa": "kPa", "N": "N"}
# Inches: of the panels; of the table, its rows, the lines before the names and around a text.
_LEFT, _WIDTH, _HEIGHT = 0.9, 5.6, 1.6
_ROW, _LINE, _AROUND = 0.24, 0.3, 0.16
_MARGIN, _FONT_PT = 0.1, 7.5
# Phases of scans are the same if they end within this share of the axis.
_SAME_SHARE = 0.02


def compare(scans: Mapping[str, Results]) -> list[list[str]]:
    """Return a table of one or more complete scans by their names: a heading, and a row for each.

    From the second scan on, numbers are followed by their difference from the first one's. A dash
    stands for what a scan does not have.
    """
    numbers = [_numbers(scan) for scan in scans.values()]
    first, keys = numbers[0], _compared(numbers)
    rows = [["scan", *_headings(keys)]]
    for name, own in zip(scans, numbers, strict=True):
        before = {} if own is first else first
        rows.append([name, *(_cell(own.get(key), before.get(key)) for key in keys)])
    return rows


def write_comparison(path: Path, scans: Mapping[str, Results]) -> None:
    """Write the figure of `comparison_figure` as a PNG."""
    write_figure(path, comparison_figure(scans))


@styled
def comparison_figure(scans: Mapping[str, Results]) -> Figure:
    """Draw forces, strain energy density and spikes of scans on common axes, and their table.

    Strain energy density is that of the receptor of the first population that is nearest to
    X = Y = 0, spikes are those of this receptor of each population. The table is also the legend.
    """
    each = [Abscissa.of(scan.trace) for scan in scans.values()]
    over, rows, colours = common(each), compare(scans), _colours(len(scans))
    populations = _distinct(name for scan in scans.values() for name in scan.trace["population"])
    columns = [_LINE, *(max(map(_inches, column)) for column in zip(*rows, strict=True))]
    heights = [_HEIGHT] * 3 + [max(0.6, 0.14 * len(scans))] * len(populations)
    width = max(_WIDTH, sum(columns) + _MARGIN - _LEFT)
    below = _ROW * len(rows) + 2 * _MARGIN
    figure, axes = panels(heights, over, width, below=below)
    share, width = inches(axes[0])[0] / width, inches(axes[0])[0]
    for (name, scan), colour in zip(scans.items(), colours, strict=True):
        _draw_histories(axes[:3], scan, over, color=colour, lw=1.2, label=name)
    _label_histories(axes[:3], scans.values(), -0.52 / width)
    for one, population in zip(axes[3:], populations, strict=True):
        _draw_spikes(one, population, scans.values(), over, colours)
    size = figure.get_size_inches()
    box = np.array([_MARGIN, _MARGIN, _LEFT + width - _MARGIN, _ROW * len(rows)])
    _draw_table(figure.add_axes(tuple(box / [*size, *size])), rows, columns, colours, share)
    return figure


def _draw_histories(axes: Sequence[Axes], scan: Results, over: Abscissa, **style: Any) -> None:
    at = over.at(scan.trace["time_s"])
    for one, of in zip(axes, ("normal", "tangential", "central_sed_kPa"), strict=True):
        one.plot(at, history(scan, of), **style)


def _label_histories(axes: Sequence[Axes], scans: Iterable[Results], at: float) -> None:
    units = " or ".join(_distinct(scan.study.finger.force_unit for scan in scans))
    felt = " or ".join(_distinct(scan.trace["population"][0] for scan in scans))
    labels = (
        f"Normal ({units})",
        f"Tangential ({units})",
        f"SED of the central\n{felt} receptor (kPa)",
    )
    for one, label in zip(axes, labels, strict=True):
        one.set(ylabel=label)
        one.set_ylim(bottom=0)
        one.yaxis.set_label_coords(at, 0.5)


def _draw_spikes(
    axes: Axes, population: str, scans: Iterable[Results], over: Abscissa, colours: Sequence[str]
) -> None:
    """Draw the spikes of the central receptor of a population, a row for each scan."""
    for k, (scan, colour) in enumerate(zip(scans, colours, strict=True)):
        own = np.flatnonzero(scan.trace["population"] == population)
        if len(own):
            central = own[central_receptor(scan.trace["receptors_mm"][own])]
            times = over.at(scan.spikes.time_s[scan.spikes.receptor == central])
            axes.plot(times, np.full(len(times), k), "|", color=colour, ms=6)
    axes.set(ylim=(len(colours) - 0.5, -0.5), yticks=[])
    axes.set_ylabel(f"Spikes of\nthe central\n{population}", rotation=0, ha="right", va="center")
    axes.yaxis.set_label_coords(-0.015, 0.5)


def common(each: Sequence[Abscissa]) -> Abscissa:
    """Return one axis for several scans.

    It is the displacement if all slide at the same speed, otherwise the time; phases that are not
    the same in all scans are left out.
    """
    first = each[0]
    alike = all(one.label == first.label and np.isclose(one.per_s, first.per_s) for one in each)
    per_s, label = (first.per_s, first.label) if alike else (1.0, TIME)
    ends = np.array([one.ends for one in each]) * [[per_s / one.per_s] for one in each]
    phases = first.phases if alike and all(_same(one, first) for one in each) else ()
    return Abscissa(label, per_s, np.array([ends[:, 0].min(), ends[:, 1].max()]), phases)


def _same(one: Abscissa, other: Abscissa) -> bool:
    if [phase.name for phase in one.phases] != [phase.name for phase in other.phases]:
        return False
    here, there = (np.array([phase[1:] for phase in over.phases]) for over in (one, other))
    return np.allclose(here, there, rtol=0.0, atol=_SAME_SHARE * float(np.ptp(other.ends)))


def _colours(count: int) -> list[str]:
    """Return distinct colours for a few scans, a scale of them for many."""
    if count <= len(DISTINCT):
        return list(DISTINCT[:count])
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.92, count))]


def _draw_table(
    axes: Axes,
    rows: Sequence[Sequence[str]],
    columns: Sequence[float],
    colours: Sequence[str],
    share: float,
) -> None:
    """Fill axes with a table; a line before each name has the colour of the scan."""
    axes.set_axis_off()
    table = axes.table(
        [["\N{BOX DRAWINGS HEAVY HORIZONTAL}" * 2, *row] for row in rows[1:]],
        colLabels=["", *rows[0]],
        colWidths=[column / sum(columns) for column in columns],
        cellLoc="center",
        bbox=Bbox.unit(),
        edges="horizontal",
    )
    table.auto_set_font_size(False)
    table.set_fontsize(share * _FONT_PT)
    for (row, column), cell in table.get_celld().items():
        cell.set(linewidth=0.4)
        if column == 0 and row:
            cell.set_text_props(color=colours[row - 1])
        if column == 1:
            cell.PAD = 0.02
            cell.set_text_props(ha="left")


def _inches(text: str) -> float:
    """Return the width of a cell."""
    return float(TextPath((0, 0), text, size=_FONT_PT).get_extents().width) / 72 + _AROUND


def _distinct(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(map(str, names)))


def _numbers(scan: Results) -> dict[str, int | float]:
    """Return the numbers of a scan, with spikes by population also if there is one only."""
    numbers, (first, *others) = numbers_of(scan), scan.study.populations
    return numbers if others else {**numbers, f"{_SPIKES}{first.name}": numbers["spikes"]}


def _compared(numbers: Sequence[Mapping[str, float]]) -> list[str]:
    keys = dict.fromkeys(key for own in numbers for key in own)
    return [key for start in (*_COMPARED, _SPIKES) for key in keys if key.startswith(start)]


def _cell(value: float | None, first: float | None) -> str:
    if value is None:
        return "\N{EN DASH}"
    digits = f"{value}" if isinstance(value, int) else f"{value:.3g}"
    return f"{digits} ({100 * (value / first - 1):+.0f} %)" if first else digits


def _headings(keys: Sequence[str]) -> list[str]:
    """Return the headings of numbers; spikes of the only population are named without it."""
    headings = [_heading(key) for key in keys]
    if not keys[-2].startswith(_SPIKES):
        headings[-1] = "Spikes"
    return headings


def _heading(key: str) -> str:
    if key.startswith(_SPIKES):
        return f"{key.removeprefix(_SPIKES)} spikes"
    start, name = next(one for one in _COMPARED.items() if key.startswith(one[0]))
    return f"{name} ({_UNITS[key.removeprefix(start)]})"
