"""A solid finger cut open on the stimulator, drawn with PyVista.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple

import numpy as np
import pyvista as pv
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.output.annotations import (
    COLOURS,
    PICTURE_DPI,
    RIGID,
    SIZE_INCHES,
    WINDOW_DPI,
    ColourBar,
    annotate,
    draw_scale,
    is_soft,
    legend_of,
    pixels,
    receptor_colours,
    receptor_labels,
)
from tactile_fem.output.film import Film
from tactile_fem.output.quantities import around_corners
from tactile_fem.path.rotations import matrix
from tactile_fem.results.results import Results
from tactile_fem.runtime.files import in_print
from tactile_fem.stimulus import RigidBody
from tactile_fem.stimulus.sampled import DistanceGrid

Vector = tuple[float, float, float]
UP = (0.0, 0.0, 1.0)

_GREY_TO_IVORY = LinearSegmentedColormap.from_list("relief", ["#8E979F", "#EEE7DA"])
RELIEF: Any = {"scalars": "height_mm", "cmap": _GREY_TO_IVORY, "smooth_shading": True}
# Edges of a surface are drawn so much nearer to the eye.
_RIM_SHIFT_MM = 0.035
# Receptors, silent and firing: colours of a single population, and radii in mm.
_RECEPTORS, _RADII_MM = ("#101010", "#FFFFFF"), (0.07, 0.1)
_RIM_WIDTH = 1.5  # pixels at the resolution of pictures
# What is flatter has no outline; by how much of VTK's unit a layer is nearer to the eye.
_LEAST_RELIEF_MM, _LAYER = 0.05, 4e3
# Distance from the receptors to the cut behind them.
_CUT_DISTANCE_MM = 0.15
# The interface is shown up to this height above its lowest point, or above the receptors.
_INTERFACE_HEIGHT_MM, _MARGIN_MM = 2.3, 0.2


class Look(NamedTuple):
    """The cut through the undeformed finger, beyond which it is removed, and a parallel camera."""

    axis: Literal["x", "y"]
    origin: Vector
    towards_eye: Vector
    focus: Vector
    half_height_mm: float

    @property
    def share_of_width(self) -> float:
        """The share of a picture's width that a millimetre on the cut takes, along its level."""
        level = 1 if self.axis == "x" else 0
        away = self.towards_eye[level] / np.linalg.norm(self.towards_eye)
        width_mm = 2 * self.half_height_mm * SIZE_INCHES[0] / SIZE_INCHES[1]
        return float(np.sqrt(1 - away**2) / width_mm)


# The cut lies beside X = 0, where meshes have faces.
_CUT_ORIGIN = (-1e-4, 0.0, 0.0)
CLOSE = Look("x", _CUT_ORIGIN, (30.0, -9.0, 17.0), (0.0, 0.6, 2.2), 8.4)
BENEATH = Look("x", (100.0, 0.0, 0.0), (14.0, -5.0, -30.0), (0.0, 0.0, 1.0), 11.0)
WHOLE = Look("x", _CUT_ORIGIN, (30.0, -9.0, 15.0), (0.0, 2.0, 3.8), 11.0)


class Scene:
    """The frames of a film of a solid finger, on the body's surface given in the body's frame.

    Values of the film colour those pieces of soft tissue that `coloured` names: the "face" of the
    cut, the "shell" behind it. The bar explains these colours.
    """

    def __init__(
        self,
        film: Film,
        stimulator: pv.PolyData,
        look: Look,
        bar: ColourBar | None = None,
        coloured: tuple[str, ...] = (),
        *,
        off_screen: bool = True,
    ) -> None:
        self.film, self.look, self.bar = film, look, bar
        on_skin = "skin" in coloured
        self.legend = legend_of({} if on_skin else RIGID if coloured else COLOURS)
        self.plotter = new_plotter(off_screen=off_screen)
        look_at(self.plotter, look.towards_eye, look.focus, look.half_height_mm)
        self._updates: list[Callable[[int], None]] = []
        # The faces first: hidden shells are then not shaded, which takes most of the time.
        for tissue, kind, mesh in sorted(_cut(film, look), key=lambda piece: piece[1]):
            if on_skin and tissue not in RIGID:
                continue
            style: dict[str, Any] = {"color": COLOURS[tissue]}
            if kind in coloured and tissue not in RIGID:
                style = {}
            style |= {"lighting": False} if kind == "face" else {"ambient": 0.25}
            self.add(f"{tissue} {kind}", mesh, **style)
            if kind == "face":
                self.add_rim(f"{tissue} rim", mesh)
        if on_skin:
            self.add("skin", _skin(film), lighting=False, below_color=COLOURS["stratum_corneum"])
            self._bring_forward("skin", 1)
        if stimulator.n_points:
            self._add_body("stimulator", stimulator, **RELIEF, opacity=0.5 if on_skin else 1.0)
            low, high = stimulator.bounds[-2:]
            # At half its height; it is seen through the finger.
            outline = stimulator.contour([(low + high) / 2], scalars="height_mm")
            if (on_skin or not coloured) and high - low > _LEAST_RELIEF_MM and outline.n_points:
                self._add_body("outline", outline, color="black", line_width=_RIM_WIDTH)
                self._bring_forward("outline", 2)

    def add(self, name: str, mesh: pv.PolyData, **style: Any) -> None:
        """Add a mesh that moves with the film; without a colour it shows the values of the film."""
        drawn = mesh.copy()
        drawn.clear_data()
        moved = mesh["moved_mm"].reshape(mesh.n_points, -1, 3)

        def move(k: int) -> None:
            drawn.points = mesh.points + np.einsum("nfi,f->ni", moved, self.film.weights[k])
            if self.bar is not None and "values" in mesh.array_names:
                values = mesh["values"].reshape(len(mesh["values"]), -1)  # of one field (n,)
                now = values @ self.film.weights[k]
                drawn["values"] = np.maximum(now, self.bar.scale.vmin) if log else now

        log = self.bar is not None and isinstance(self.bar.scale, LogNorm)
        if "color" not in style and self.bar is not None:
            ends = self.bar.scale.vmin, self.bar.scale.vmax
            style |= {"scalars": "values", "cmap": self.bar.colours, "clim": ends, "log_scale": log}
        self._add(name, drawn, move, **style)

    def add_rim(self, name: str, mesh: pv.PolyData) -> None:
        """Add the boundary of a surface that moves with the film."""
        edges = mesh.extract_feature_edges(feature_edges=False, manifold_edges=False)
        eye = np.array(self.look.towards_eye)
        shifted = edges.translate(_RIM_SHIFT_MM * eye / np.linalg.norm(eye))
        self.add(name, shifted, color="black", line_width=_RIM_WIDTH)

    def _add_body(self, name: str, mesh: pv.PolyData, **style: Any) -> None:
        """Add a part of the body."""
        drawn, normals = mesh.copy(), mesh.point_data.active_normals

        def place(k: int) -> None:
            drawn.points = self.film.in_space(mesh.points, k)
            if normals is not None and (turn := self.film.turn_rad(k)) is not None:
                # In place, as the plotter draws a shallow copy.
                drawn.point_data.active_normals[:] = normals @ matrix(turn).T

        self._add(name, drawn, place, **style)

    def _bring_forward(self, name: str, layer: int) -> None:
        """Draw something before all of lower layers, however far behind it is."""
        mapper = self.plotter.actors[name].mapper
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -_LAYER * layer)
        mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, -_LAYER * layer)

    def add_receptors(self, places_mm: NDArray[np.float64]) -> None:
        """Add a ball at each undeformed place (r, 3), coloured by population."""
        film, ball = self.film, pv.Sphere(radius=1.0, theta_resolution=16, phi_resolution=16)
        # They move with the tetrahedra as drawn, which deviate from the quadratic solution.
        sampled = pv.PolyData(places_mm).sample(_grid(film), snap_to_closest_point=True)
        moved = sampled["moved_mm"].reshape(len(places_mm), -1, 3)
        names, kind = np.unique(film.population, return_inverse=True)
        colours = receptor_colours(film.population, _RECEPTORS)
        balls = pv.PolyData()

        def place(k: int) -> None:
            centres = pv.PolyData(places_mm + np.einsum("rfi,f->ri", moved, film.weights[k]))
            fired = film.fired[k].astype(int)
            centres["colour"] = (2 * kind + fired).astype(float)
            centres["radius_mm"] = np.array(_RADII_MM)[fired]
            balls.copy_from(centres.glyph(orient=False, scale="radius_mm", geom=ball))

        chosen = [colours[label] for name in names for label in receptor_labels(name, names)]
        style = {"scalars": "colour", "cmap": chosen, "clim": (0, len(chosen) - 1), "ambient": 0.4}
        self._add("receptors", balls, place, **style)
        self.legend |= colours

    def _add(
        self, name: str, mesh: pv.PolyData, update: Callable[[int], None], **style: Any
    ) -> None:
        update(0)
        self._updates.append(update)
        quiet = {"reset_camera": False, "render": False, "show_scalar_bar": False}
        self.plotter.add_mesh(mesh, name=name, **quiet, **style)

    def show(self, k: int) -> None:
        """Draw frame `k`."""
        for update in self._updates:
            update(k)
        self.plotter.reset_camera_clipping_range()
        self.plotter.render()

    def figure(self, k: int, dots_per_inch: float = PICTURE_DPI) -> Figure:
        """Return frame `k` with title, legend, colour bar and scale bar."""
        size, dots_per_inch = in_print.get().layout(SIZE_INCHES, dots_per_inch)
        for actor in self.plotter.actors.values():
            actor.prop.line_width = _RIM_WIDTH * dots_per_inch / PICTURE_DPI
        self.show(k)
        figure = Figure(figsize=size, dpi=dots_per_inch)
        # Exactly as large, as resampling takes half as long as drawing.
        figure.figimage(shot(self.plotter, *pixels(dots_per_inch, size)), zorder=-1)
        annotate(figure, self.film.titles[k], self.legend, self.bar)
        draw_scale(figure, self.look.share_of_width)
        return figure


# --- scenes ------------------------------------------------------------------------------------


def deformation_scene(results: Results, film: Film, *, off_screen: bool = True) -> Scene:
    """Return the finger coloured by the film: cut along X = 0, or its skin from beneath."""
    assert film.shown is not None
    look, coloured = (BENEATH, "skin") if film.shown.is_on_skin else (CLOSE, "face")
    surface, bar = stimulator_surface(results), _bar(film)
    scene = Scene(film, surface, look, bar, (coloured,), off_screen=off_screen)
    scene.legend |= film.shown.categories
    return scene


def receptor_scene(results: Results, film: Film, *, off_screen: bool = True) -> Scene:
    """Return the finger cut behind its receptors, with the interface on which they lie."""
    receptors = results.trace["receptors_mm"]
    cut = float(receptors[:, 1].min()) - _CUT_DISTANCE_MM
    sides = [one.receptors.side for one in results.study.populations]
    surface = interface(film, next((s for s in sides if s in ("epidermis", "dermis")), "epidermis"))
    highest = float(receptors[:, 2].max())
    rim = max(surface.bounds.z_min + _INTERFACE_HEIGHT_MM, highest + _MARGIN_MM)
    look = Look("y", (0.0, cut, 0.0), (9.0, 27.5, 20.4), (0.0, cut + 0.5, 3.6), 9.6)
    front = surface.clip("y", origin=look.origin, invert=False).clip("z", origin=(0.0, 0.0, rim))
    top = max(float(np.percentile(front["values"], 99.8, axis=0).max()), 1e-6)
    bar = ColourBar("SED on the interface (kPa)", Normalize(0.0, top))
    scene = Scene(film, stimulator_surface(results), look, bar, off_screen=off_screen)
    scene.add("interface", front, lighting=False)
    scene.add_rim("interface rim", front)
    scene.add_receptors(receptors)
    return scene


def vibration_scene(results: Results, film: Film, *, off_screen: bool = True) -> Scene:
    """Return the vibrating finger cut along X = 0, coloured by the amplitude."""
    surface, coloured = stimulator_surface(results), ("face", "shell")
    return Scene(film, surface, WHOLE, _bar(film), coloured, off_screen=off_screen)


def _bar(film: Film) -> ColourBar:
    assert film.shown is not None
    shown, scale = film.shown, film.shown.scale(film.limits)
    label = "" if shown.categories else shown.label  # these are in the legend
    return ColourBar(label, scale, shown.colours(film.limits))


# --- meshes ------------------------------------------------------------------------------------


def stimulator_surface(results: Results) -> pv.PolyData:
    """Return the part of the surface of the stimulator, in its frame, that comes near the finger.

    It is the zero level of the signed distance, which a scan saves for an own body.
    """
    if results.stimulator is not None:
        return _zero_level(results.stimulator)
    trace, body = results.trace, results.study.stimulus.body()
    return body_surface(body, trace["stimulator_mm"], trace.get("stimulator_rad"))


def body_surface(
    body: RigidBody, places_mm: NDArray[np.float64], turns_rad: NDArray[np.float64] | None = None
) -> pv.PolyData:
    """Return that surface of a body that comes to places and turns (n, 3), as smooth as felt.

    It is empty if the body does not come near the finger.
    """
    surface = _zero_level(DistanceGrid.of(body, places_mm, turns_rad))
    if surface.n_points:
        surface.point_data.active_normals = body.distance(surface.points.astype(float)).normal
    return surface


def _zero_level(grid: DistanceGrid) -> pv.PolyData:
    """Return the surface at which a distance vanishes; its normals are the gradient."""
    if grid.is_empty:
        return pv.PolyData()
    spacing = (grid.step_mm,) * 3
    image = pv.ImageData(dimensions=grid.gap_mm.shape[::-1], spacing=spacing, origin=grid.origin_mm)
    image["depth_mm"] = -grid.gap_mm.ravel()
    surface = image.contour([0.0], scalars="depth_mm", method="flying_edges", compute_normals=True)
    surface["height_mm"] = surface.points[:, 2]
    return surface


def _grid(film: Film) -> pv.UnstructuredGrid:
    """Return the undeformed tetrahedra with the fields, one column for each component."""
    mesh = film.mesh
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: mesh.cells}, mesh.nodes)
    grid.cell_data["tissue"] = mesh.tissue
    grid.point_data["node"] = np.arange(len(mesh.nodes))
    grid.point_data["moved_mm"] = np.moveaxis(film.moved_mm, 0, 1).reshape(len(mesh.nodes), -1)
    of_nodes = film.values.shape[1] == len(mesh.nodes)
    (grid.point_data if of_nodes else grid.cell_data)["values"] = film.values.T
    return grid


def _cut(film: Film, look: Look) -> Iterator[tuple[str, str, pv.PolyData]]:
    """Yield for each tissue its "face" on the cut and its "shell" behind, undeformed."""
    grid = _grid(film)
    for name, tag in TISSUES.items():
        part = grid.extract_values(tag, scalars="tissue").cell_data_to_point_data()
        face = part.slice(look.axis, origin=look.origin)
        shell = part.extract_surface(algorithm=None).clip(look.axis, origin=look.origin)
        for kind, mesh in (("face", face), ("shell", shell)):
            if mesh.n_points:
                yield name, kind, mesh


def _skin(film: Film) -> pv.PolyData:
    """Return the undeformed skin with the fields, of categories one piece around each node."""
    surface = _grid(film).extract_surface(algorithm=None)
    soft = is_soft(surface.cell_data["tissue"])
    if film.shown is None or not film.shown.categories:
        return surface.extract_cells(soft).extract_surface(algorithm=None)
    facets = surface["node"][surface.regular_faces[soft]]
    parts = around_corners(film.mesh.nodes, facets).reshape(-1, 3)
    pieces = pv.PolyData.from_regular_faces(parts, np.arange(len(parts)).reshape(-1, 4))
    moved = around_corners(np.moveaxis(film.moved_mm, 0, 1), facets)
    pieces.point_data["moved_mm"] = moved.reshape(len(parts), -1)
    pieces.cell_data["values"] = film.values[:, facets.ravel()].T
    return pieces


def interface(film: Film, side: str) -> pv.PolyData:
    """Return the facets between epidermis and dermis, with the fields of one of these."""
    own, beyond = (film.mesh.tissue == TISSUES[name] for name in ("epidermis", "dermis"))
    if side == "dermis":
        own, beyond = beyond, own
    surface = _grid(film).extract_cells(own).extract_surface(algorithm=None)
    shared = np.isin(surface["node"], film.mesh.cells[beyond])
    facets = shared[surface.regular_faces].all(axis=1)
    if not facets.any():
        raise StudyError("The fields have no interface between epidermis and dermis to view.")
    between = surface.extract_cells(facets).extract_surface(algorithm=None)
    return between.cell_data_to_point_data()


# --- plotters ----------------------------------------------------------------------------------


def new_plotter(*, off_screen: bool = True) -> pv.Plotter:
    """Return a plotter with a white background."""
    size = pixels(WINDOW_DPI)
    plotter = pv.Plotter(title="tactile-fem", window_size=size, off_screen=off_screen)
    plotter.set_background("white")
    if off_screen:
        plotter.enable_anti_aliasing("ssaa")
    return plotter


def look_at(
    plotter: pv.Plotter, towards_eye: Vector, focus: Vector, half_height_mm: float, up: Vector = UP
) -> None:
    """Set a parallel camera."""
    plotter.camera_position = [np.add(focus, towards_eye), focus, up]
    plotter.enable_parallel_projection()
    plotter.parallel_scale = half_height_mm


def shot(plotter: pv.Plotter, width: int, height: int) -> NDArray[np.uint8]:
    """Return an image (height, width, 3)."""
    plotter.window_size = (width, height)
    plotter.reset_camera_clipping_range()
    return np.asarray(plotter.screenshot(return_img=True))
