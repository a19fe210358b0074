"""Pictures and films of a section: layers, strain energy density, receptors as they fire.

They need Matplotlib only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.tri import Triangulation
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import TISSUES, FingerMesh
from tactile_fem.finger.plane import AXES, Plane
from tactile_fem.finger.simplex import FLAT, facets_of
from tactile_fem.output.colours import COLOURS, is_soft
from tactile_fem.output.gif import write_gif
from tactile_fem.output.histories import TIME, at_time
from tactile_fem.output.plots import styled
from tactile_fem.output.timeline import Timeline
from tactile_fem.runtime.logs import counted
from tactile_fem.simulation.fields import read_series
from tactile_fem.simulation.results import Results
from tactile_fem.stimulus import RigidBody

Array = NDArray[np.float64]
# A quadratic triangle as four straight ones.
_QUARTERS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
_STIMULATOR = "#B9BDC2"
_SILENT, _FIRING = "#101010", "#FF3B30"
# The body's surface is found on a grid of so many points.
_GRID = (900, 400)
_MARGIN_MM = 0.6
# Frames from one saved state to the next.
BETWEEN = 2


@dataclass(frozen=True)
class Shape:
    """A section as it is drawn.

    Attributes
    ----------
    plane
        In which it lies.
    nodes
        (n, 2) undeformed, mm.
    cells, tissue
        (m, 6) in VTK's order, which is gmsh's; (m,) tags.
    """

    plane: Plane
    nodes: Array
    cells: NDArray[np.int64]
    tissue: NDArray[np.int64]

    @classmethod
    def of(cls, mesh: FingerMesh) -> Shape:
        """Return the shape of a mesh."""
        return cls(mesh.plane, mesh.plane.within(mesh.nodes), mesh.cells, mesh.tissue)

    @classmethod
    def read(cls, file: Path) -> Shape:
        """Return the shape that a field file holds."""
        grid = meshio.read(file)
        points = np.asarray(grid.points, dtype=float)
        plane = Plane.through(points)
        tissue = np.asarray(grid.cell_data["tissue"][0])
        return cls(plane, plane.within(points), grid.cells_dict[FLAT.meshio], tissue)

    def triangles(self, moved: ArrayLike = 0.0) -> Triangulation:
        """Return four straight triangles for each cell, displaced by (n, 2)."""
        x, y = (self.nodes + np.asarray(moved)).T
        return Triangulation(x, y, self.cells[:, _QUARTERS].reshape(-1, 3))

    def limits(self, moved: ArrayLike = 0.0) -> LineCollection:
        """Return the lines between tissues and around them."""
        facets, first, second = facets_of(self.cells)
        beside = np.where(second < 0, 0, self.tissue[second])
        ends = np.sort(facets[self.tissue[first] != beside], axis=1)
        at = self.nodes + np.asarray(moved)
        return LineCollection(at[ends], colors="black", linewidths=0.4)


def layers_figure(mesh: FingerMesh, body: RigidBody, start_mm: ArrayLike) -> Figure:
    """Draw the undeformed layers and the body where it starts."""
    shape, figure = Shape.of(mesh), Figure(figsize=(9, 5.4), layout="constrained")
    axes = figure.subplots()
    _draw_layers(axes, shape)
    _draw_body(axes, shape, _gap_of(body), np.asarray(start_mm))
    _frame(axes, shape)
    names = [name for name, tag in TISSUES.items() if np.any(shape.tissue == tag)]
    handles = [Patch(color=COLOURS[name], label=name.replace("_", " ")) for name in names]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    return figure


@dataclass(frozen=True)
class Moment:
    """A section at one time.

    Attributes
    ----------
    time_s, displacement_mm
        Since the slide began.
    moved
        Displacement of the nodes, (n, 2) mm.
    sed_kPa
        Of the cells, (m,).
    receptors_mm
        Deformed, (r, 2).
    fired
        Whether they have fired since the moment before, (r,).
    stimulator_mm
        Place of the body, (3,).
    """

    time_s: float
    displacement_mm: float
    moved: Array
    sed_kPa: Array
    receptors_mm: Array
    fired: NDArray[np.bool_]
    stimulator_mm: Array


class SectionFilm:
    """Moments of a section's scan: its saved states and linear interpolations between them.

    Attributes
    ----------
    shape
        The section.
    gap
        Signed distance (n,) of the stimulator at points (n, 3) of its frame.
    top_kPa
        Upper end of the colour scale.
    strongest
        Number of the moment with the largest strain energy density.
    along, label
        Displacement or time of each moment, and which of them it is.

    Raises
    ------
    StudyError
        There are no field files.
    """

    def __init__(self, results: Results) -> None:
        written_s, self._files = read_series(results.fields)
        if not self._files:
            raise StudyError(f"There are no field files in {results.fields}: nothing to view.")
        self._results = results
        self.shape = Shape.read(self._files[0])
        body = results.stimulator
        self.gap = body.gap if body else _gap_of(results.study.stimulus.body())
        fields = [meshio.read(file) for file in counted(self._files, "saved states to read")]
        self._moved = [
            self.shape.plane.within(f.point_data["displacement_mm"]).astype(float) for f in fields
        ]
        self._sed = [np.asarray(f.cell_data["sed_kPa"][0], dtype=float) for f in fields]
        tops = [np.percentile(sed[is_soft(self.shape.tissue)], 99.5) for sed in self._sed]
        self.top_kPa, self.strongest = max(*tops, 1e-6), BETWEEN * int(np.argmax(tops))
        self._timeline = Timeline.of(results, written_s, BETWEEN)
        self.label, self.along = self._timeline.label, self._timeline.along

    def __len__(self) -> int:
        return len(self._timeline)

    def nearest(self, value: float) -> int:
        """Return the number of the moment nearest to a value of `along`."""
        return self._timeline.nearest(value)

    def __getitem__(self, k: int) -> Moment:
        before, share = divmod(k, BETWEEN)
        after, share = min(before + 1, len(self._files) - 1), share / BETWEEN
        moved, sed = (
            (1 - share) * values[before] + share * values[after]
            for values in (self._moved, self._sed)
        )
        time, trace = float(self._timeline.times_s[k]), self._results.trace
        receptors = trace["receptors_mm"] + at_time(trace, "moved_mm", time)
        return Moment(
            time,
            float(self._timeline.displacement_mm[k]),
            moved,
            sed,
            self.shape.plane.within(receptors),
            self._timeline.fired(self._results, k),
            at_time(trace, "stimulator_mm", time),
        )


@styled
def moment_figure(film: SectionFilm, k: int, *, dots_per_inch: int = 200) -> Figure:
    """Draw moment `k`: the deformed layers, their strain energy density, the firing receptors."""
    shape, moment = film.shape, film[k]
    figure = Figure(figsize=(7.5, 4.6), dpi=dots_per_inch, layout="constrained")
    axes = figure.subplots()
    sed = np.where(is_soft(shape.tissue), np.maximum(moment.sed_kPa, film.top_kPa / 1000), np.nan)
    _draw_layers(axes, shape, moment.moved)
    image = axes.tripcolor(
        shape.triangles(moment.moved),
        facecolors=np.repeat(np.ma.masked_invalid(sed), 4),
        norm=LogNorm(film.top_kPa / 1000, film.top_kPa),
        cmap="viridis",
        rasterized=True,
    )
    axes.add_collection(shape.limits(moment.moved))
    _draw_body(axes, shape, film.gap, moment.stimulator_mm)
    for which, colour, size in ((~moment.fired, _SILENT, 4), (moment.fired, _FIRING, 22)):
        axes.scatter(*moment.receptors_mm[which].T, s=size, color=colour, zorder=5, linewidths=0)
    _frame(axes, shape, close=True)
    bar = figure.colorbar(image, ax=axes, extend="both", shrink=0.8)
    bar.set_label("Strain energy density (kPa)")
    over_time = film.label == TIME
    axes.set_title(
        f"Time {moment.time_s:.3f} s"
        if over_time
        else f"Displacement {moment.displacement_mm:.2f} mm"
    )
    return figure


def images(film: SectionFilm) -> Iterator[Image.Image]:
    """Yield a film's images."""
    for k in counted(range(len(film)), "frames to draw"):
        canvas = FigureCanvasAgg(moment_figure(film, k, dots_per_inch=110))
        canvas.draw()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def save_gif(film: SectionFilm, path: Path) -> None:
    """Write an animation, 20 frames a second."""
    write_gif([image.quantize(200) for image in images(film)], path)


# --- parts of figures --------------------------------------------------------------------------


def _draw_layers(axes: Axes, shape: Shape, moved: ArrayLike = 0.0) -> None:
    for name, tag in TISSUES.items():
        own = shape.tissue == tag
        if own.any():
            part = Shape(shape.plane, shape.nodes, shape.cells[own], shape.tissue[own])
            axes.tripcolor(
                part.triangles(moved),
                facecolors=np.zeros(4 * own.sum()),
                cmap=ListedColormap([COLOURS[name]]),
                rasterized=True,
            )
    axes.add_collection(shape.limits(moved))


def _gap_of(body: RigidBody) -> Callable[[Array], Array]:
    return lambda points: body.distance(points).gap


def _draw_body(axes: Axes, shape: Shape, gap_of: Callable[[Array], Array], place_mm: Array) -> None:
    """Fill the body, cut by the plane."""
    place = shape.plane.within(place_mm)
    low, high = shape.nodes.min(axis=0) - _MARGIN_MM, shape.nodes.max(axis=0) + _MARGIN_MM
    low[1], high[1] = place[1] - 4.0, place[1] + 1.0
    x, z = (np.linspace(a, b, n) for a, b, n in zip(low, high, _GRID, strict=True))
    grid = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    gap = gap_of(shape.plane.points(grid) - place_mm).reshape(len(z), len(x))
    axes.contourf(x, z, gap, [-np.inf, 0.0], colors=_STIMULATOR, zorder=3)
    if gap.min() < 0 < gap.max():
        axes.contour(x, z, gap, [0.0], colors="black", linewidths=0.8, zorder=4)


def _frame(axes: Axes, shape: Shape, *, close: bool = False) -> None:
    """Set limits, equal scales and labels; from close by only the pad is shown."""
    low, high = shape.nodes.min(axis=0), shape.nodes.max(axis=0)
    if close:
        low[0], high[0] = max(low[0], -9.0), min(high[0], 9.0)
        high[1] = 6.5
    axes.set_xlim(low[0] - _MARGIN_MM, high[0] + _MARGIN_MM)
    axes.set_ylim(low[1] - 1.5, high[1] + _MARGIN_MM)
    axes.set_aspect("equal")
    across, up = (AXES[axis] for axis in shape.plane.axes)
    axes.set_xlabel(f"{across} (mm)")
    axes.set_ylabel(f"{up} (mm)")
