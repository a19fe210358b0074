"""A section of the finger, drawn with Matplotlib alone: it needs no graphics library."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.finger.plane import AXES
from tactile_fem.finger.simplex import facets_of
from tactile_fem.output.annotations import (
    COLOURS,
    PICTURE_DPI,
    RIGID,
    SIZE_INCHES,
    ShownFigure,
    dots,
    is_soft,
    legend_of,
    receptor_colours,
    receptor_labels,
)
from tactile_fem.output.film import Film
from tactile_fem.output.plots import styled
from tactile_fem.output.quantities import around_corners
from tactile_fem.path.rotations import swept
from tactile_fem.runtime.files import in_print
from tactile_fem.stimulus import RigidBody

Array = NDArray[np.float64]

_BODY_COLOUR = "#B9BDC2"
# Receptors, silent and firing: colours of a single population, sizes, and widths of their edges.
_RECEPTORS, _SIZES, _EDGES = ("#101010", "#FF3B30"), (7, 24), (0.0, 0.4)
# The nodes around a quadratic triangle.
_TRIANGLE_BOUNDARY = [0, 3, 1, 4, 2, 5]
_MARGIN_MM, _MARGIN_BELOW_MM = 0.6, 1.5
# The body is sampled at these intervals, from below its contact plane, at least, to above it.
_SPACING_MM, _BODY_HEIGHTS_MM = (0.03, 0.0125), (-4.0, 1.0)
# Fields are shown in the pad: half its width, and its height.
_PAD_SIZE_MM = 9.0, 6.5
# Of the legend, which is higher in a narrow figure, by a share of what that lacks.
_COLUMN_INCHES, _MORE_ROWS = 1.25, 0.25


class SectionScene:
    """The frames of a film of a section: fields in the pad, or the layers of a finger at rest.

    `gap_of` returns the signed distance (n,) of the body at points (n, 3) of its frame.
    """

    def __init__(self, film: Film, gap_of: Callable[[Array], Array]) -> None:
        self.film, self._plane = film, film.mesh.plane
        self._nodes = self._plane.within(film.mesh.nodes)
        facets, first, second = facets_of(film.mesh.cells)
        beside = np.where(second < 0, 0, film.mesh.tissue[second])
        self._edges = facets[film.mesh.tissue[first] != beside]
        self._skin = facets[(second < 0) & is_soft(film.mesh.tissue[first])]
        present = [name for name, tag in TISSUES.items() if np.any(film.mesh.tissue == tag)]
        self.legend = legend_of(present)
        (left, low), (right, high) = self._nodes.min(axis=0), self._nodes.max(axis=0)
        if (shown := film.shown) is not None:
            if not shown.is_on_skin:
                self.legend = legend_of(name for name in RIGID if name in present)
            population = () if film.population is None else film.population
            self.legend |= receptor_colours(population, _RECEPTORS) | shown.categories
            half_width, high = _PAD_SIZE_MM
            left, right = max(left, -half_width), min(right, half_width)
        self._x_limits = left - _MARGIN_MM, right + _MARGIN_MM
        self._z_limits = low - _MARGIN_BELOW_MM, high + _MARGIN_MM
        box = zip(self._x_limits, self._z_limits, strict=True)
        corners = (self._plane.vectors(corner) for corner in box)
        ends = swept(*corners, film.stimulator_mm, film.stimulator_rad)
        (left, low), (right, _) = map(self._plane.within, ends)
        lowest, highest = _BODY_HEIGHTS_MM
        x = np.arange(left, right, _SPACING_MM[0])
        z = np.arange(min(low, lowest), highest, _SPACING_MM[1])
        self._sampled = self._plane.vectors(np.stack(np.meshgrid(x, z), axis=-1))
        beside = np.zeros(3)
        beside[self._plane.across] = film.stimulator_mm[0, self._plane.across]
        self._gap = gap_of(self._sampled.reshape(-1, 3) - beside).reshape(len(z), len(x))

    @styled
    def figure(self, k: int, dots_per_inch: float = PICTURE_DPI) -> Figure:
        """Return frame `k` with title, legend and, for fields, a colour bar."""
        film, mesh, within = self.film, self.film.mesh, self._plane.within
        weights = film.weights[k]
        nodes = self._nodes + within(np.tensordot(weights, film.moved_mm, 1))
        colours = np.empty((len(mesh.cells), 4))
        for name, tag in TISSUES.items():
            colours[mesh.tissue == tag] = to_rgba(COLOURS[name])
        size, dots_per_inch = in_print.get().layout(SIZE_INCHES, dots_per_inch)
        high = size[1] + _MORE_ROWS * max(0.0, SIZE_INCHES[0] - size[0])
        figure = ShownFigure(figsize=(size[0], high), dpi=dots_per_inch, layout="constrained")
        axes = figure.subplots()
        if (shown := film.shown) is not None:
            scale = ScalarMappable(shown.scale(film.limits), shown.colours(film.limits))
            values = film.weights[k] @ film.values
            if shown.is_on_skin:
                parts = around_corners(nodes, self._skin)
                own = scale.to_rgba(values[self._skin.ravel()])
                axes.add_collection(LineCollection(parts, colors=own, linewidths=5, zorder=3.5))
            else:
                soft = is_soft(mesh.tissue)
                if len(values) == len(nodes):
                    values = values[mesh.cells].mean(axis=1)
                colours[soft] = scale.to_rgba(np.maximum(values, scale.norm.vmin))[soft]
            if not shown.categories:
                figure.colorbar(scale, ax=axes, extend="both", shrink=0.8, label=shown.label)
        around = nodes[mesh.cells[:, _TRIANGLE_BOUNDARY]]
        style = {"edgecolors": "face", "linewidths": 0.3, "rasterized": True}
        axes.add_collection(PolyCollection(around, facecolors=colours, **style))
        axes.add_collection(LineCollection(nodes[self._edges], colors="black", linewidths=0.4))
        self._draw_body(axes, k)
        if film.receptors_mm is not None:
            self._draw_receptors(axes, within(film.receptors_mm[k]), film.fired[k])
        axes.set(xlim=self._x_limits, ylim=self._z_limits, aspect="equal")
        figure.suptitle(film.titles[k], wrap=True)  # also above the bar
        across, up = (f"{AXES[axis]} (mm)" for axis in self._plane.axes)
        axes.set(xlabel=across, ylabel=up)
        style = {"ncols": int(size[0] / _COLUMN_INCHES), "fontsize": 8}
        figure.legend(handles=dots(self.legend), loc="outside lower center", **style)
        return figure

    def _draw_receptors(self, axes: Axes, places: Array, fired: NDArray[np.bool_]) -> None:
        population = self.film.population
        names = list(dict.fromkeys(population.tolist()))
        colours = receptor_colours(population, _RECEPTORS)
        for name in names:
            labels, own = receptor_labels(name, names), population == name
            looks = zip(labels, (~fired, fired), _SIZES, _EDGES, strict=True)
            for label, which, size, edge in looks:
                style = {"color": colours[label], "ec": "black", "zorder": 5}
                axes.scatter(*places[own & which].T, s=size, linewidths=edge, **style)

    def _draw_body(self, axes: Axes, k: int) -> None:
        """Fill the body where the plane cuts it."""
        x, z = np.moveaxis(self._plane.within(self.film.in_space(self._sampled, k)), -1, 0)
        gap = self._gap
        axes.contourf(x, z, gap, [-np.inf, 0.0], colors=_BODY_COLOUR, zorder=3)
        if gap.min() < 0 < gap.max():
            axes.contour(x, z, gap, [0.0], colors="black", linewidths=0.8, zorder=4)


def gap_of(body: RigidBody) -> Callable[[Array], Array]:
    """Return the signed distance (n,) of a body at points (n, 3)."""
    return lambda points: body.distance(points).gap
