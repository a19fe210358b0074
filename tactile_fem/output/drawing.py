"""Pictures made with PyVista: the layered finger, and the finger cut open on the stimulator.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyvista as pv
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.output.colours import COLOURS, RIGID, is_soft
from tactile_fem.simulation.results import Results
from tactile_fem.stimulus import RigidBody
from tactile_fem.stimulus.distance_grid import DistanceGrid

SCALE = "viridis"
_RELIEF = LinearSegmentedColormap.from_list("relief", ["#8E979F", "#EEE7DA"])
RELIEF_STYLE = {"scalars": "height_mm", "cmap": _RELIEF, "smooth_shading": True}
RIM_STYLE = {"color": "black", "line_width": 1.5}
# Matplotlib rounds pixels / dots per inch * dots per inch down: for some heights to one less.
_PIXELS, _DOTS_PER_INCH = (1500, 955), 200
_FAR = 1e3


# --- figures -----------------------------------------------------------------------------------


def finger_figure(grid: pv.UnstructuredGrid) -> Figure:
    """Draw quadratic tetrahedra with cell data ``tissue``, a quarter of them cut away."""
    solid = linear(grid, grid.points)
    plotter = off_screen()
    tissues = dict(parts(solid))
    # The faces first: what they hide is then not shaded, which takes most of the time.
    styles = {n: {"color": COLOURS[n], "show_edges": True, "line_width": 1} for n in tissues}
    for name, part in tissues.items():
        for face in _opened_faces(part):
            plotter.add_mesh(face, edge_opacity=0.5, lighting=False, **styles[name])
    for name, part in tissues.items():
        shell = part.extract_surface(algorithm=None)
        shell = shell.clip_box((0, _FAR, 0, _FAR, -_FAR, _FAR), invert=True)
        if shell.n_cells:
            outside = shell.extract_surface(algorithm=None)
            plotter.add_mesh(outside, edge_opacity=0.3, ambient=0.4, diffuse=0.7, **styles[name])
    x, y, z = solid.center
    size = solid.length
    middle = (x + 0.02 * size, y, z - 0.07 * size)
    image = picture(plotter, (26.0, 34.0, -12.0), middle, half_height=0.27 * size)
    figure = framed(image)
    handles = [Patch(color=COLOURS[name], label=name.replace("_", " ")) for name in tissues]
    figure.legend(handles=handles, loc="lower right", frameon=False, fontsize=9)
    return figure


def deformation_figure(
    grid: pv.UnstructuredGrid,
    stimulator: pv.PolyData,
    limits_kPa: tuple[float, float],
    title: str,
) -> Figure:
    """Draw the deformed finger cut open at X = 0, on the stimulator's surface.

    The quadratic tetrahedra have ``displacement_mm``, ``sed_kPa`` and ``tissue``. `limits_kPa` are
    the ends of the logarithmic colour scale.
    """
    solid = linear(grid, grid.points + grid["displacement_mm"])
    plotter = off_screen()
    tissues = dict(parts(solid))
    # The faces first: what they hide is then not shaded, which takes most of the time.
    for name, part in tissues.items():
        face = part.cell_data_to_point_data().slice("x", origin=(-1e-4, 0, 0))
        if not face.n_cells:
            continue
        face["sed_kPa"] = np.maximum(face["sed_kPa"], limits_kPa[0])
        if name in RIGID:
            plotter.add_mesh(face, color=COLOURS[name], lighting=False)
        else:
            plotter.add_mesh(
                face,
                scalars="sed_kPa",
                cmap=SCALE,
                clim=limits_kPa,
                log_scale=True,
                lighting=False,
                show_scalar_bar=False,
            )
        plotter.add_mesh(rim(face, (0.03, 0, 0)), **RIM_STYLE)
    for name, part in tissues.items():
        shell = part.extract_surface(algorithm=None)
        shell = shell.clip_box((-_FAR, 0, -_FAR, _FAR, -_FAR, _FAR), invert=False)
        if shell.n_cells:
            behind = shell.extract_surface(algorithm=None)
            plotter.add_mesh(behind, color=COLOURS[name if name in RIGID else "stratum_corneum"])
    add_stimulator(plotter, stimulator)
    image = picture(plotter, (30.0, -9.0, 17.0), (0.0, 0.6, 2.2), half_height=8.4)
    figure = framed(image)
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 3}
    figure.text(0.02, 0.97, title, fontsize=10, va="top", bbox=box)
    bar = figure.colorbar(
        ScalarMappable(LogNorm(*limits_kPa), SCALE),
        cax=figure.add_axes((0.3, 0.085, 0.4, 0.022)),
        orientation="horizontal",
        extend="both",
    )
    bar.set_label("Strain energy density (kPa)", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    bar.ax.xaxis.set_major_formatter("{x:g}")
    return figure


def colour_limits(grids: list[pv.UnstructuredGrid]) -> tuple[float, float]:
    """Return a common colour scale: up to the 99.8th percentile, from a thousandth of it."""
    soft = [grid["sed_kPa"][is_soft(grid["tissue"])] for grid in grids]
    top = max(float(np.percentile(np.concatenate(soft), 99.8)), 1e-6)
    return top / 1000, top


def stimulator_surface(results: Results) -> pv.PolyData:
    """Return the part of the stimulator's surface that comes near the finger, in the body's frame.

    It is the zero level of the signed distance, which a scan saves for an own body.
    """
    if results.stimulator is not None:
        surface = zero_level(results.stimulator)
    else:
        surface = body_surface(results.study.stimulus.body(), results.trace["stimulator_mm"])
    surface["height_mm"] = surface.points[:, 2]
    return surface


def body_surface(body: RigidBody, places_mm: NDArray[np.float64]) -> pv.PolyData:
    """Return that surface of a body that comes to places (n, 3), as smooth as the skin feels it.

    It is empty if the body does not come near the finger.
    """
    surface = zero_level(DistanceGrid.of(body, places_mm))
    if surface.n_points:
        surface.point_data.active_normals = body.distance(surface.points.astype(float)).normal
    return surface


def zero_level(grid: DistanceGrid) -> pv.PolyData:
    """Return the surface at which a distance vanishes; its normals are the distance's gradient."""
    if grid.is_empty:
        return pv.PolyData()
    spacing = (grid.step_mm,) * 3
    image = pv.ImageData(dimensions=grid.gap_mm.shape[::-1], spacing=spacing, origin=grid.origin_mm)
    image["depth_mm"] = -grid.gap_mm.ravel()
    return image.contour([0.0], scalars="depth_mm", method="flying_edges", compute_normals=True)


# --- parts of figures --------------------------------------------------------------------------


def off_screen(pixels: tuple[int, int] = _PIXELS) -> pv.Plotter:
    """Return an off-screen plotter with a white background and anti-aliasing."""
    plotter = pv.Plotter(off_screen=True, window_size=pixels)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    return plotter


def add_stimulator(plotter: pv.Plotter, surface: pv.PolyData) -> None:
    """Add a body's surface with ``height_mm``, unless it is empty."""
    if surface.n_points:
        plotter.add_mesh(surface, show_scalar_bar=False, **RELIEF_STYLE)


def picture(
    plotter: pv.Plotter, eye: tuple[float, ...], at: tuple[float, ...], half_height: float
) -> NDArray[np.uint8]:
    """Return the image of a parallel camera in direction `eye` from the point `at`, Z upwards."""
    position = tuple(a + e for a, e in zip(at, eye, strict=True))
    plotter.camera_position = [position, at, (0.0, 0.0, 1.0)]
    return shot(plotter, half_height)


def shot(plotter: pv.Plotter, half_height: float) -> NDArray[np.uint8]:
    """Return a parallel camera's image, half of it so many mm high, and close the plotter."""
    plotter.enable_parallel_projection()
    plotter.parallel_scale = half_height
    plotter.reset_camera_clipping_range()
    image = np.asarray(plotter.screenshot(return_img=True))
    plotter.close()
    return image


def framed(image: NDArray[np.uint8]) -> Figure:
    """Return a figure filled by an image, for annotations."""
    height, width = image.shape[:2]
    size = width / _DOTS_PER_INCH, height / _DOTS_PER_INCH
    figure = Figure(figsize=size, dpi=_DOTS_PER_INCH)
    figure.figimage(image, zorder=-1)  # as it is, because resampling takes half as long as drawing
    return figure


def linear(grid: pv.UnstructuredGrid, points: NDArray[np.floating]) -> pv.UnstructuredGrid:
    """Return linear tetrahedra, without the mid-nodes: VTK cuts these cleanly."""
    corners = grid.cells.reshape(-1, 11)[:, 1:5]
    linear = pv.UnstructuredGrid({pv.CellType.TETRA: corners}, np.asarray(points, dtype=float))
    linear.cell_data.update(grid.cell_data)
    return linear


def parts(solid: pv.UnstructuredGrid) -> Iterator[tuple[str, pv.UnstructuredGrid]]:
    """Yield the name and the cells of each tissue."""
    for name, tag in TISSUES.items():
        inside = np.flatnonzero(solid["tissue"] == tag)
        if len(inside):
            yield name, solid.extract_cells(inside)


def rim(surface: pv.PolyData, shift_mm: tuple[float, float, float]) -> pv.PolyData:
    """Return a surface's boundary, shifted towards the camera so that the surface hides none."""
    edges = surface.extract_feature_edges(
        boundary_edges=True, feature_edges=False, manifold_edges=False
    )
    return edges.translate(shift_mm)


def deformed(mesh: pv.PolyData) -> pv.PolyData:
    """Return a surface moved by its ``displacement_mm``."""
    moved = mesh.copy()
    moved.points = mesh.points + mesh["displacement_mm"]
    return moved


def _opened_faces(part: pv.UnstructuredGrid) -> Iterator[pv.PolyData]:
    """Yield the two faces exposed by removing the quarter X > 0, Y > 0."""
    beside = {"x": (-_FAR, _FAR, 0, _FAR, -_FAR, _FAR), "y": (0, _FAR, -_FAR, _FAR, -_FAR, _FAR)}
    for normal, box in beside.items():
        face = part.slice(normal, origin=(1e-4, 1e-4, 0.0))
        if face.n_cells:
            face = face.clip_box(box, invert=False).extract_surface(algorithm=None)
        if face.n_cells:
            yield face
