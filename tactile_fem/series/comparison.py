"""The scans of a series side by side: histories on common axes, and numbers with differences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import DISTINCT
from tactile_fem.output.histories import TIME, central_receptor
from tactile_fem.output.panels import panels
from tactile_fem.output.plots import styled
from tactile_fem.runtime.files import write_figure
from tactile_fem.series.members import Member
from tactile_fem.series.run import numbers_of
from tactile_fem.simulation.results import Results

Array = NDArray[np.float64]

# Of the numbers of a scan, see `numbers_of`: those that are compared, and their headings.
_COMPARED = {
    "pressed_": "Pressed",
    "normal_": "Normal",
    "tangential_": "Tangential",
    "central_largest_sed_": "Central SED",
    "spikes": "Spikes",
}
_WIDTH, _HEIGHT, _LEGEND, _ROW = 5.2, 1.6, 2.3, 0.24  # inches


def compare(members: Sequence[Member], folder: Path) -> list[list[str]]:
    """Return a table of the complete scans of a series: a heading, and a row for each.

    From the second scan on, numbers are followed by their difference to the first one's.
    """
    return _table(*_complete(members, folder))


def write_comparison(members: Sequence[Member], folder: Path) -> Path | None:
    """Write ``comparison.png`` of the complete scans of a series; None if there are not two."""
    names, scans = _complete(members, folder)
    if len(scans) < 2:
        return None
    path = folder / "comparison.png"
    write_figure(path, comparison_figure(names, scans))
    return path


def _complete(members: Sequence[Member], folder: Path) -> tuple[list[str], list[Results]]:
    scans = {one.name: Results(folder / one.name) for one in members}
    complete = {name: scan for name, scan in scans.items() if scan.complete}
    return list(complete), list(complete.values())


def _table(names: Sequence[str], scans: Sequence[Results]) -> list[list[str]]:
    numbers = [numbers_of(scan) for scan in scans]
    first = numbers[0]
    keys = [
        key
        for start in _COMPARED
        for key in first
        if key.startswith(start) and (start != "spikes" or key == start)
    ]
    rows = [["scan", *map(_heading, keys)], [names[0], *(f"{first[key]:.3g}" for key in keys)]]
    for name, own in zip(names[1:], numbers[1:], strict=True):
        rows.append([name, *(_beside(own[key], first[key]) for key in keys)])
    return rows


@styled
def comparison_figure(names: Sequence[str], scans: Sequence[Results]) -> Figure:
    """Draw forces, strain energy density and spikes of scans on common axes, and their table.

    Strain energy density and spikes are those of the receptor of the first population that is
    nearest to X = Y = 0.
    """
    each = [Abscissa.of(scan.trace) for scan in scans]
    over = common(each)
    unit = scans[0].study.finger.force_unit
    height = max(0.6, 0.14 * len(scans))
    figure, axes = panels([_HEIGHT] * 3 + [height], over, _WIDTH, right=_LEGEND)
    normal, tangential, sed, spikes = axes
    for k, (scan, colour) in enumerate(zip(scans, _colours(len(scans)), strict=True)):
        trace, at = scan.trace, over.at(scan.trace["time_s"])
        force = trace["force_N"]
        style: dict[str, Any] = {"color": colour, "lw": 1.2}
        central = central_receptor(trace["receptors_mm"], trace["population"])
        normal.plot(at, force[:, 2], label=names[k], **style)
        tangential.plot(at, np.hypot(force[:, 0], force[:, 1]), **style)
        sed.plot(at, trace["sed_kPa"][:, central], **style)
        times = over.at(scan.spikes.time_s[scan.spikes.receptor == central])
        spikes.plot(times, np.full(len(times), k), "|", color=colour, ms=6)
    normal.set_ylabel(f"Normal ({unit})")
    tangential.set_ylabel(f"Tangential ({unit})")
    sed.set_ylabel("SED (kPa)")
    spikes.set(ylabel="Spikes", ylim=(len(scans) - 0.5, -0.5), yticks=[])
    for one in (normal, tangential, sed):
        one.set_ylim(bottom=0)
    normal.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=7, borderaxespad=0)
    return _with_table(figure, _table(names, scans))


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
    return np.allclose(here, there, rtol=1e-3, atol=1e-3 * float(np.ptp(other.ends)))


def _colours(count: int) -> list[str]:
    """Return distinct colours for a few scans, a scale of them for many."""
    if count <= len(DISTINCT):
        return list(DISTINCT[:count])
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.92, count))]


def _with_table(figure: Figure, rows: list[list[str]]) -> Figure:
    """Make a figure taller by a table below its panels."""
    width, before = figure.get_size_inches()
    extra = _ROW * len(rows) + 0.3
    height = before + extra
    places = {axes: axes.get_position() for axes in figure.axes}
    figure.set_size_inches(width, height)
    for axes, box in places.items():
        low = (box.y0 * before + extra) / height
        axes.set_position((box.x0, low, box.width, box.height * before / height))
    below: Axes = figure.add_axes((0.02, 0.1 / height, 0.96, (extra - 0.2) / height))
    below.set_axis_off()
    table = below.table(rows[1:], colLabels=rows[0], loc="center", edges="horizontal")
    table.auto_set_font_size(False)
    table.set_fontsize(7.5)
    table.auto_set_column_width(list(range(len(rows[0]))))
    for cell in table.get_celld().values():
        cell.set(linewidth=0.4, height=1 / len(rows))
    return figure


def _beside(value: float, first: float) -> str:
    if not first:
        return f"{value:.3g}"
    return f"{value:.3g} ({100 * (value / first - 1):+.0f} %)"


def _heading(key: str) -> str:
    """Return the heading of a number: its name, and the unit in which its key ends."""
    name = next(heading for start, heading in _COMPARED.items() if key.startswith(start))
    units = {"N_per_mm": "N/mm", "kPa": "kPa", "N": "N"}
    unit = next((unit for end, unit in units.items() if key.endswith(f"_{end}")), "")
    return f"{name} ({unit})" if unit else name
