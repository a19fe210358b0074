"""Maps of fields on the pad: the lower side of the skin or of an interface, from above."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from tactile_fem.finger.plane import AXES
from tactile_fem.finger.simplex import Indices
from tactile_fem.output.annotations import BLUE, dots
from tactile_fem.output.plots import styled
from tactile_fem.output.quantities import Quantity, around_corners, quantity_of
from tactile_fem.results.surfaces import SurfaceFields

Array = NDArray[np.float64]

# What exceeds this share of the largest value is shown, with a margin.
_SHOWN_SHARE, _MARGIN_MM = 0.02, 0.5
_AXES_INCHES = 4.4


@styled
def surface_map(surface: SurfaceFields, show: str = "sed_kPa", title: str = "") -> Figure:
    """Draw a column of `SurfaceFields.table`, or a quantity, over the undeformed places.

    Y is to the right. Only the lower side of the closed surface is drawn. Of a section, values are
    drawn over Y or X. By default the title states time and displacement. StudyError if there is no
    such column.
    """
    columns = {f"{AXES[k].lower()}_mm": own for k, own in enumerate(surface.points_mm.T)}
    columns |= surface.columns
    quantity = quantity_of(show, columns, "the surface")
    values, facets = quantity.of(columns[quantity.column]), surface.facets[faces_down(surface)]
    draw = _draw_line if facets.shape[1] == 2 else _draw_map
    figure = draw(surface, values, facets, quantity)
    state = f"{1000 * surface.time_s:.0f} ms, displacement {surface.at_mm:.2f} mm"
    figure.axes[0].set_title(title or state, size=9, wrap=True)
    return figure


def _draw_line(surface: SurfaceFields, values: Array, facets: Indices, of: Quantity) -> Figure:
    figure = Figure(figsize=(_AXES_INCHES + 1.0, 3.4), layout="constrained")
    axes, axis = figure.subplots(), int(np.ptp(surface.points_mm, axis=0)[:2].argmax())
    lines = np.stack([surface.points_mm[:, axis], values], axis=-1)[facets]
    if of.categories:
        lines = around_corners(surface.points_mm[:, [axis, axis]], facets)
        lines[..., 1] = values[facets].reshape(-1, 1)
    axes.add_collection(LineCollection(list(lines), colors=BLUE))
    axes.autoscale_view()
    axes.set(xlabel=f"{AXES[axis]} (mm)", ylabel=of.label)
    if of.categories:
        axes.set_yticks(range(len(of.categories)), list(of.categories))
    return figure


def _draw_map(surface: SurfaceFields, values: Array, facets: Indices, of: Quantity) -> Figure:
    x, y = surface.points_mm[:, 0], surface.points_mm[:, 1]
    used = np.unique(facets)
    size = np.abs(values[used])
    is_shown = np.isin(facets, used[size >= _SHOWN_SHARE * size.max()])
    shown = np.unique(facets[is_shown.any(axis=1)])  # with the facets around them
    left, right = y[shown].min() - _MARGIN_MM, y[shown].max() + _MARGIN_MM
    top, bottom = x[shown].min() - _MARGIN_MM, x[shown].max() + _MARGIN_MM
    height = _AXES_INCHES * (bottom - top) / (right - left)
    figure = Figure(figsize=(_AXES_INCHES + 1.6, height + 1.0), layout="constrained")
    axes = figure.subplots()
    if of.categories:
        colours = np.array(list(of.categories.values()))[values[facets.ravel()].astype(int)]
        parts = around_corners(np.column_stack([y, x]), facets)
        axes.add_collection(PolyCollection(parts, facecolors=colours, edgecolors="face", lw=0.2))
        figure.legend(handles=dots(of.categories), loc="outside right center", fontsize=8)
    else:
        limits = of.limits(values[None, used])
        style = {"cmap": of.colours(limits), "norm": Normalize(*limits), "shading": "gouraud"}
        filled = axes.tripcolor(Triangulation(y, x, facets), values, **style)
        bar = figure.colorbar(filled, cax=axes.inset_axes((1.03, 0.0, 0.035, 1.0)), label=of.label)
        bar.outline.set_visible(False)
    axes.set(xlabel="Y (mm)", ylabel="X (mm)", aspect="equal")
    axes.set(xlim=(left, right), ylim=(bottom, top))  # letters are upright
    return figure


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
