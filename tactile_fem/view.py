"""The deformation to look at: a window with a slider, an animation, a page for the browser.

The finger is cut across at the receptors. Behind the cut it stands in its layers; before it only
the epidermis-dermis interface is left, coloured by strain energy density, with the receptors on it.

Import it only where a graphics library is known to load: see `tactile_fem.pictures`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
import pyvista as pv
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from PIL import Image

from tactile_fem import drawing
from tactile_fem.errors import StudyError
from tactile_fem.fields import read_series
from tactile_fem.files import replacing, write_text
from tactile_fem.finger.mesh_data import TISSUES, facets_of
from tactile_fem.pictures import Surface, at_time
from tactile_fem.results import Results

logger = logging.getLogger(__name__)

_SED = "Strain energy density\non the interface (kPa)"
_SED_COLOURS = "viridis"
# Colour and radius in mm.
_SILENT, _FIRING = ("#101010", 0.07), ("#FFFFFF", 0.1)
_LINE = {"color": "black", "line_width": 1.5}
# Frames from one written state to the next.
_BETWEEN = 4
# The cut is this far behind the receptors, so that they stand before it.
_BEHIND_MM = 0.15
# The interface is shown up to this height over its lowest point, where it looks down.
_BOWL_MM, _DOWN = 2.3, -0.3
_PIXELS = (1100, 700)
_PER_SECOND, _DPI = 20, 112


# --- what there is to see ----------------------------------------------------------------------


@dataclass(frozen=True)
class State:
    """The finger and its receptors at one time.

    Attributes
    ----------
    time_s, displacement_mm
        Since the slide began.
    solid
        Undeformed tetrahedra by their corners, with ``displacement_mm`` and ``tissue``.
    interface
        Undeformed facets between epidermis and dermis over the pad, with ``displacement_mm`` and
        ``sed_kPa`` at their nodes.
    receptors_mm
        (receptors, 3), where they have moved to.
    fired
        (receptors,) whether they did so since the frame before.
    stimulator
        Its surface, in place.
    """

    time_s: float
    displacement_mm: float
    solid: pv.UnstructuredGrid
    interface: pv.PolyData
    receptors_mm: NDArray[np.float64]
    fired: NDArray[np.bool_]
    stimulator: pv.StructuredGrid


class Film:
    """A scan frame by frame: the states that were written, and linear in time between them.

    Raises
    ------
    StudyError
        There are no field files, or they do not fit.
    """

    def __init__(self, results: Results) -> None:
        self._written_s, self._files = read_series(results.fields)
        if not self._files:
            raise StudyError(f"There are no field files in {results.fields}: nothing to view.")
        self._trace, self._spikes = results.trace, results.spikes
        self._surface = Surface(results.study, window_mm=np.inf)
        self._interface = Interface(_read(self._files[0]), results.study.receptors.side)
        self._anchors = self._interface.anchors(self._trace["receptors_mm"])
        frames = np.arange(_BETWEEN * (len(self._files) - 1) + 1) / _BETWEEN
        self._times_s = np.interp(frames, np.arange(len(self._files)), self._written_s)
        self.displacement_mm = at_time(self._trace, "displacement_mm", self._times_s)
        self.cut_mm = float(self._trace["receptors_mm"][:, 1].min()) - _BEHIND_MM
        tops = [np.percentile(self._interface.sed_kPa(_read(p)), 99.8) for p in self._files]
        self.top_kPa = max(*tops, 1e-6)
        self.strongest = _BETWEEN * int(np.argmax(tops))

    def __len__(self) -> int:
        return len(self._times_s)

    def nearest(self, displacement_mm: float) -> int:
        """Return the number of the frame next to a displacement."""
        return int(np.argmin(np.abs(self.displacement_mm - displacement_mm)))

    def __getitem__(self, k: int) -> State:
        time = self._times_s[k]
        solid = self._fields(k)
        interface = self._interface.of(solid)
        recent = (self._spikes.time_s > self._times_s[max(k - 1, 0)]) & (
            self._spikes.time_s <= time
        )
        fired = np.zeros(len(self._trace["receptors_mm"]), dtype=bool)
        fired[self._spikes.receptor[recent]] = True
        translation = at_time(self._trace, "stimulator_mm", time)
        return State(
            time_s=float(time),
            displacement_mm=float(self.displacement_mm[k]),
            solid=solid,
            interface=interface,
            receptors_mm=self._anchors.follow(interface),
            fired=fired,
            stimulator=drawing.relief(*self._surface.at(translation)),
        )

    def _fields(self, k: int) -> pv.UnstructuredGrid:
        """Return the undeformed tetrahedra with the fields of a frame."""
        before, share = divmod(k, _BETWEEN)
        grid = _read(self._files[before])
        solid = drawing.linear(grid, grid.points)
        solid["displacement_mm"] = grid["displacement_mm"]
        if share:
            after = _read(self._files[before + 1])
            for name in ("displacement_mm", "sed_kPa"):
                solid[name] = solid[name] + share / _BETWEEN * (after[name] - solid[name])
        return solid


class Interface:
    """The facets between epidermis and dermis that look down on the stimulator.

    Parameters
    ----------
    grid
        Quadratic tetrahedra with ``tissue``.
    side
        Tissue whose strain energy density is shown.
    """

    def __init__(self, grid: pv.UnstructuredGrid, side: str) -> None:
        facets, *cells = facets_of(grid.cells.reshape(-1, 11)[:, 1:])
        tissues = np.where(np.array(cells) >= 0, grid["tissue"][np.array(cells)], 0)
        pair = [TISSUES["epidermis"], TISSUES["dermis"]]
        between = (np.sort(tissues, axis=0) == np.array(pair)[:, None]).all(axis=0)
        a, b, c = np.moveaxis(grid.points[facets], 1, 0)
        normal = np.cross(b - a, c - a)
        outward = np.where(tissues[0] == TISSUES["dermis"], 1, -1)[:, None] * normal
        chosen = between & (outward[:, 2] < _DOWN * np.linalg.norm(normal, axis=1))
        if not chosen.any():
            raise StudyError("The fields have no interface between epidermis and dermis to view.")
        owner = np.where(tissues[0] == TISSUES[side], *cells)[chosen]
        self._nodes, corners = np.unique(facets[chosen], return_inverse=True)
        self._corners = corners.reshape(-1, 3)
        self._owner = owner
        self._rest = pv.PolyData.from_regular_faces(grid.points[self._nodes], self._corners)

    def sed_kPa(self, grid: pv.UnstructuredGrid) -> NDArray[np.float64]:
        """Return the strain energy density at the nodes: the mean of the facets around."""
        around = np.bincount(self._corners.ravel(), minlength=len(self._nodes))
        values = np.repeat(grid["sed_kPa"][self._owner], 3)
        return np.bincount(self._corners.ravel(), values, len(self._nodes)) / around

    def of(self, grid: pv.UnstructuredGrid) -> pv.PolyData:
        """Return the undeformed facets with ``displacement_mm`` and ``sed_kPa`` at their nodes."""
        surface = self._rest.copy()
        surface["displacement_mm"] = grid["displacement_mm"][self._nodes]
        surface["sed_kPa"] = self.sed_kPa(grid)
        return surface

    def anchors(self, places_mm: NDArray[np.float64]) -> Anchors:
        """Tie undeformed places to the facets next to them."""
        facet, foot = self._rest.find_closest_cell(places_mm, return_closest_point=True)
        a, b, c = np.moveaxis(self._rest.points[self._corners[facet]], 1, 0)
        edges = np.stack([b - a, c - a], axis=2)
        local = np.einsum("pij,pj->pi", np.linalg.pinv(edges), foot - a)
        weights = np.column_stack([1 - local.sum(axis=1), local])
        return Anchors(self._corners[facet], weights, places_mm - foot)


@dataclass(frozen=True)
class Anchors:
    """Places that go along with a surface.

    Attributes
    ----------
    nodes, weights
        (n, 3) corners of the facet below each, and its barycentric coordinates.
    offset_mm
        (n, 3) from there.
    """

    nodes: NDArray[np.int64]
    weights: NDArray[np.float64]
    offset_mm: NDArray[np.float64]

    def follow(self, surface: pv.PolyData) -> NDArray[np.float64]:
        """Return where the places are now, (n, 3) mm."""
        corners = deformed(surface).points[self.nodes]
        return np.einsum("pc,pci->pi", self.weights, corners) + self.offset_mm


def _read(path: Path) -> pv.UnstructuredGrid:
    """Return a written state; raise StudyError if it is none."""
    try:
        grid = pv.read(path)
        if all(name in grid.array_names for name in ("displacement_mm", "sed_kPa", "tissue")):
            return grid
    except (OSError, ValueError):
        pass
    raise StudyError(f"{path} cannot be read as a field file of a scan.")


def deformed(mesh: pv.PolyData) -> pv.PolyData:
    """Return a surface moved by its ``displacement_mm``."""
    moved = mesh.copy()
    moved.points = mesh.points + mesh["displacement_mm"]
    return moved


# --- how it is shown ---------------------------------------------------------------------------


class Scene:
    """Draws frames into a plotter, each in place of the one before."""

    def __init__(self, plotter: pv.Plotter, film: Film) -> None:
        self._plotter, self._film = plotter, film
        plotter.set_background("white")
        focus = (0.0, film.cut_mm + 0.5, 3.6)
        eye = (9.0, film.cut_mm + 28.0, 24.0)
        plotter.camera_position = [eye, focus, (0.0, 0.0, 1.0)]
        plotter.enable_parallel_projection()
        plotter.parallel_scale = 9.6

    def show(self, k: int) -> State:
        """Draw the frame number `k` and return its state."""
        state = self._film[k]
        for name, mesh, look in _pieces(state, self._film):
            self._plotter.remove_actor(name, render=False)
            if mesh.n_points:
                self._plotter.add_mesh(
                    mesh,
                    name=name,
                    reset_camera=False,
                    render=False,
                    show_scalar_bar=False,
                    **look,
                )
        self._plotter.reset_camera_clipping_range()
        self._plotter.render()
        return state


def _pieces(state: State, film: Film) -> Iterator[tuple[str, pv.DataSet, dict]]:
    """Yield everything to be drawn: a name, a mesh and its look."""
    cut = (0.0, film.cut_mm, 0.0)
    for name, part in drawing.parts(state.solid):
        colour = drawing.COLOURS[name]
        shell = part.extract_surface(algorithm=None).clip("y", origin=cut)
        yield f"{name} shell", deformed(shell), {"color": colour, "ambient": 0.25}
        face = deformed(part.slice("y", origin=cut))
        yield f"{name} face", face, {"color": colour, "lighting": False}
        # A little towards the eye, so that the face does not hide its own rim.
        yield f"{name} rim", _rim(face).translate((0, 0.03, 0.03)), _LINE
    carpet = state.interface.clip("y", origin=cut, invert=False)
    lowest = state.interface.bounds.z_min
    carpet = deformed(carpet.clip("z", origin=(0, 0, lowest + _BOWL_MM)))
    look = {
        "scalars": "sed_kPa",
        "cmap": _SED_COLOURS,
        "clim": (0, film.top_kPa),
        "lighting": False,
    }
    yield "interface", carpet, look
    yield "interface rim", _rim(carpet).translate((0, 0.03, 0.03)), _LINE
    for name, which, (colour, radius) in (
        ("silent", ~state.fired, _SILENT),
        ("firing", state.fired, _FIRING),
    ):
        points = pv.PolyData(state.receptors_mm[which])
        balls = points.glyph(geom=pv.Sphere(radius=radius), scale=False, orient=False)
        yield name, balls, {"color": colour, "ambient": 0.4}
    stimulator = state.stimulator
    stimulator["height_mm"] = stimulator.points[:, 2]
    look = {"scalars": "height_mm", "cmap": drawing.RELIEF, "smooth_shading": True}
    yield "stimulator", stimulator, look


def _rim(surface: pv.PolyData) -> pv.PolyData:
    return surface.extract_feature_edges(
        boundary_edges=True, feature_edges=False, manifold_edges=False
    )


# --- where it goes -----------------------------------------------------------------------------


def window(film: Film) -> None:
    """Open a window with a slider over the slide, and wait until it is closed."""
    plotter = _window_plotter(film, off_screen=False)
    plotter.show()


def _window_plotter(film: Film, *, off_screen: bool) -> pv.Plotter:
    plotter = pv.Plotter(window_size=_PIXELS, title="tactile-fem", off_screen=off_screen)
    scene = Scene(plotter, film)
    scene.show(0)
    _colour_bar(plotter)
    legend = [[name, colour] for name, colour in _legend().items()]
    plotter.add_legend(legend, face="circle", loc="lower left", size=(0.2, 0.3))
    if len(film) > 1:
        plotter.add_slider_widget(
            lambda displacement_mm: scene.show(film.nearest(displacement_mm)),
            (film.displacement_mm[0], film.displacement_mm[-1]),
            title="Displacement (mm)",
            color="black",
            fmt="%.1f",
            pointa=(0.03, 0.91),
            pointb=(0.33, 0.91),
        )
    return plotter


def save_html(film: Film, k: int, path: Path) -> None:
    """Write the frame number `k` as a page that turns and zooms in a browser."""
    plotter = pv.Plotter(off_screen=True, window_size=_PIXELS)
    state = Scene(plotter, film).show(k)
    _colour_bar(plotter)
    page = plotter.trame.export_html(None).read()
    plotter.close()
    rows = "".join(
        f'<br><span style="color:{colour};text-shadow:0 0 1px black">&#9679;</span> {name}'
        for name, colour in _legend().items()
    )
    box = (
        '<div style="position:fixed;left:1em;top:1em;padding:.5em 1em;background:#ffffffe6;'
        f'font:15px/1.5 sans-serif;pointer-events:none">{_title(state)}{rows}</div>'
    )
    write_text(path, page.replace("</body>", f"{box}</body>"))


def save_gif(film: Film, path: Path) -> None:
    """Write an animation, 20 frames a second."""
    first, *others = [_few_colours(image) for image in frames(film)]
    with replacing(path) as part:
        first.save(
            part,
            format="GIF",
            save_all=True,
            append_images=others,
            duration=1000 // _PER_SECOND,
            loop=0,
        )


def save_mp4(film: Film, path: Path) -> None:
    """Write an animation, 20 frames a second."""
    import imageio_ffmpeg

    images = frames(film)
    first = next(images)
    with replacing(path) as part:
        stream = imageio_ffmpeg.write_frames(
            str(part),
            first.size,
            fps=_PER_SECOND,
            macro_block_size=2,
            output_params=["-f", "mp4"],
        )
        stream.send(None)
        for image in chain([first], images):
            stream.send(image.tobytes())
        stream.close()


def frames(film: Film) -> Iterator[Image.Image]:
    """Yield the pictures of an animation, with colour bar and legend."""
    logger.info("%d frames to draw", len(film))
    plotter = drawing.off_screen(_PIXELS)
    scene = Scene(plotter, film)
    for k in range(len(film)):
        state = scene.show(k)
        yield _framed(np.asarray(plotter.screenshot(return_img=True)), state, film.top_kPa)
    plotter.close()


def _framed(image: NDArray[np.uint8], state: State, top_kPa: float) -> Image.Image:
    figure = drawing.framed(image)
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.9, "pad": 4}
    figure.text(0.02, 0.97, _title(state), fontsize=11, va="top", bbox=box)
    dot = {"ls": "", "marker": "o", "ms": 7, "mec": "black", "mew": 0.7}
    handles = [Line2D([], [], color=c, label=name, **dot) for name, c in _legend().items()]
    look = {"loc": "lower left", "fontsize": 9, "framealpha": 0.9, "edgecolor": "none"}
    figure.legend(handles=handles, handletextpad=0.2, **look)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, top_kPa), _SED_COLOURS),
        cax=figure.add_axes((0.87, 0.56, 0.016, 0.38)),
        extend="max",
    )
    bar.set_label(_SED, fontsize=9)
    bar.ax.tick_params(labelsize=8)
    figure.set_dpi(_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _few_colours(image: Image.Image) -> Image.Image:
    return image.quantize(256, dither=Image.Dither.NONE)


def _title(state: State) -> str:
    return f"Displacement {state.displacement_mm:.1f} mm, {1000 * state.time_s:.0f} ms"


def _legend() -> dict[str, str]:
    layers = {name.replace("_", " "): colour for name, colour in drawing.COLOURS.items()}
    return {**layers, "receptor, silent": _SILENT[0], "receptor, firing": _FIRING[0]}


def _colour_bar(plotter: pv.Plotter) -> None:
    plotter.add_scalar_bar(
        title=_SED,
        mapper=plotter.actors["interface"].mapper,
        color="black",
        vertical=True,
        position_x=0.88,
        position_y=0.5,
        height=0.42,
        width=0.06,
        fmt="%.1f",
    )
