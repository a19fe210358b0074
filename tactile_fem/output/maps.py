"""Maps of fields on the pad: the lower side of the skin or of an interface, from above."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.plane import AXES
from tactile_fem.finger.simplex import Indices
from tactile_fem.output.annotations import BLUE, SCALE
from tactile_fem.output.plots import styled
from tactile_fem.results.surfaces import SurfaceFields

Array = NDArray[np.float64]

# What exceeds this share of the largest value is shown, with a margin.
_SHOWN_SHARE, _MARGIN_MM = 0.02, 1.0
_AXES_INCHES = 4.4
_COLOURS = 256


@styled
def surface_map(surface: SurfaceFields, column: str = "sed_kPa") -> Figure:
    """Draw a column of `SurfaceFields.table` over the undeformed places, Y to the right.

    Only the lower side of the closed surface is drawn. Of a section, values are drawn over Y or X.

    Raises
    ------
    StudyError
        There is no such column.
    """
    table = surface.table()
    if column not in table:
        raise StudyError(f"{column} is no column of the surface: choose {', '.join(table)}.")
    values, facets = table[column], surface.facets[faces_down(surface)]
    draw = _draw_line if facets.shape[1] == 2 else _draw_map
    return draw(surface, values, facets, _label(column))


def _draw_line(surface: SurfaceFields, values: Array, facets: Indices, label: str) -> Figure:
    figure = Figure(figsize=(_AXES_INCHES + 1.0, 3.4), layout="constrained")
    axes, axis = figure.subplots(), int(np.ptp(surface.points_mm, axis=0)[:2].argmax())
    lines = np.stack([surface.points_mm[:, axis], values], axis=-1)[facets]
    axes.add_collection(LineCollection(list(lines), colors=BLUE))
    axes.autoscale_view()
    axes.set(xlabel=f"{AXES[axis]} (mm)", ylabel=label)
    axes.set_title(_state(surface), size=9)
    return figure


def _draw_map(surface: SurfaceFields, values: Array, facets: Indices, label: str) -> Figure:
    x, y = surface.points_mm[:, 0], surface.points_mm[:, 1]
    used = np.unique(facets)
    size = np.abs(values[used])
    shown = used[size >= _SHOWN_SHARE * size.max()]
    left, right = y[shown].min() - _MARGIN_MM, y[shown].max() + _MARGIN_MM
    top, bottom = x[shown].min() - _MARGIN_MM, x[shown].max() + _MARGIN_MM
    height = _AXES_INCHES * (bottom - top) / (right - left)
    figure = Figure(figsize=(_AXES_INCHES + 1.6, height + 1.0), layout="constrained")
    axes = figure.subplots()
    low, high = values[used].min(), values[used].max()
    levels = np.linspace(low, high if high > low else low + 1.0, _COLOURS)
    axes.tricontourf(Triangulation(y, x, facets), values, levels, cmap=SCALE)
    scale = ScalarMappable(Normalize(*levels[[0, -1]]), SCALE)
    bar = figure.colorbar(scale, cax=axes.inset_axes((1.03, 0.0, 0.035, 1.0)), label=label)
    bar.outline.set_visible(False)
    axes.set(xlabel="Y (mm)", ylabel="X (mm)", aspect="equal")
    axes.set(xlim=(left, right), ylim=(bottom, top))  # letters are upright
    axes.set_title(_state(surface), size=9)
    return figure


def _state(surface: SurfaceFields) -> str:
    return f"{1000 * surface.time_s:.0f} ms, displacement {surface.at_mm:.2f} mm"


def _label(column: str) -> str:
    """Return the name of a column as it is written: contact pressure (kPa)."""
    name, _, unit = column.rpartition("_")
    if unit not in ("mm", "mm2", "kPa"):
        return column.replace("_", " ").capitalize()
    words = "strain energy density" if name == "sed" else name.replace("_", " ")
    return f"{words.capitalize()} ({unit.replace('2', '²')})"


def faces_down(surface: SurfaceFields) -> NDArray[np.bool_]:
    """Return which facets face the stimulator, (k,): their normals point down."""
    corners = surface.points_mm[surface.facets]
    centre, edges = corners.mean(axis=1), corners[:, 1:] - corners[:, :1]
    away = centre - surface.points_mm.mean(axis=0)
    if edges.shape[1] == 1:  # lines: the part of Z that is normal to them
        along = edges[:, 0]
        share = along[:, 2] / np.einsum("ki,ki->k", along, along)
        normal = np.array([0.0, 0.0, 1.0]) - share[:, None] * along
    else:
        normal = np.cross(edges[:, 0], edges[:, 1])
    outwards = np.sign(np.einsum("ki,ki->k", normal, away))
    return np.asarray(outwards * normal[:, 2] <= 0)  # all of a plane
