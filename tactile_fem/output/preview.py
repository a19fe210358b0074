"""A picture of finger and stimulator before a scan, and of surfaces that do not make a finger."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.simplex import Triangles
from tactile_fem.output.annotations import COLOURS, ShownFigure, dots, legend_of
from tactile_fem.output.film import Film
from tactile_fem.output.pictures import prepare_drawing
from tactile_fem.output.section import SectionScene, gap_of
from tactile_fem.path import Path
from tactile_fem.path.rotations import to_body
from tactile_fem.runtime.logs import shown
from tactile_fem.simulation.checks import checked_mesh, path_of, warn_if_missed, warn_if_sharp
from tactile_fem.stimulus import RigidBody
from tactile_fem.study import Study

if TYPE_CHECKING:
    import pyvista as pv

logger = logging.getLogger(__name__)

Extent = tuple[float, float, float, float]

# Dots per inch on a screen; a file may have more.
_SIZE_INCHES, _DPI, _PIXELS = (11.5, 5.2), 80, (1050, 1050)
# Shown around the path of the contact point, from above.
_MARGIN_MM = 11.0
_PATH_COLOUR = "#C8553D"
# Surfaces are seen from two sides, skin and nail through; the radius of the ball on a place.
_EYES = {"From the side": (40.0, -10.0, 12.0), "From the pad": (10.0, -6.0, -40.0)}
_OPACITIES = {"stratum_corneum": 0.35, "nail": 0.7}
_BALL_RADIUS_MM = 0.6


@shown()
def preview(study: Study) -> Figure:
    """Return a figure of finger and stimulator before a scan, and where the contact point goes.

    What a scan would refuse is refused, and what it would warn of is logged. Takes seconds, and
    needs PyVista, which a section does not, but no DOLFINx.

    Raises
    ------
    StudyError
        The study cannot be scanned.
    MeshError
        The finger cannot be meshed.
    TactileError
        A graphics library is missing.
    """
    prepare_drawing(study.finger.section_plane)
    finger, body = checked_mesh(study), study.stimulus.body()
    path = path_of(study, finger.pad_thickness_mm)
    warn_if_missed(body, path, finger)
    warn_if_sharp(body, path, finger)
    path.announce()
    logger.info("drawing finger and stimulator")
    return preview_figure(finger, body, path)


def preview_figure(finger: FingerMesh, body: RigidBody, path: Path) -> Figure:
    """Draw the undeformed finger on the body where it starts.

    A solid finger is cut open at X = 0; beside it are the body and the path over it from above.
    """
    film = Film.at_rest(finger, path.start_mm, path.start_rad)
    if not finger.plane.is_space:
        return SectionScene(film, gap_of(body)).figure(0, _DPI)
    from tactile_fem.output import scene

    places, turns = path.places_mm(), path.turns_rad()
    surface = scene.body_surface(body, places, turns if turns.any() else None)
    figure = ShownFigure(figsize=_SIZE_INCHES, dpi=_DPI)
    side = scene.shot(scene.Scene(film, surface, scene.WHOLE).plotter, *_PIXELS)
    _show(figure, (0.0, 0.1, 0.5, 0.82), side, "Where it starts, cut at X = 0")
    contact = to_body(np.zeros((1, 3)), places, turns)[:, 0, :2]
    rim = finger.nodes[ConvexHull(finger.nodes[:, :2]).vertices] * [1.0, 1.0, 0.0]
    _draw_from_above(figure, film.in_body(rim, 0)[:, :2], surface, contact)
    style = {"loc": "lower left", "ncols": 6, "frameon": False, "fontsize": 8}
    figure.legend(handles=dots(legend_of(COLOURS)), **style)
    return figure


def _draw_from_above(
    figure: Figure, rim: NDArray[np.float64], surface: pv.PolyData, path: NDArray[np.float64]
) -> None:
    """Draw the heights of a body, the finger's rim and the path of the contact point over it.

    These are (n, 2) in the body's own frame, in which the finger is where it starts.
    """
    from tactile_fem.output import scene

    x, y = (path.min(axis=0) + path.max(axis=0)) / 2
    half = float(np.ptp(path, axis=0).max() / 2 + _MARGIN_MM)
    plotter = scene.new_plotter()
    if surface.n_points:
        plotter.add_mesh(surface, show_scalar_bar=False, **scene.RELIEF)
    scene.look_at(plotter, (0.0, 0.0, 100.0), (x, y, 0.0), half, up=(0.0, 1.0, 0.0))
    above, extent = scene.shot(plotter, *_PIXELS), (x - half, x + half, y - half, y + half)
    title = "From above: path of the contact point"
    axes = _show(figure, (0.56, 0.16, 0.42, 0.74), above, title, extent)
    outline = np.vstack([rim, rim[:1]])
    axes.plot(*outline.T, "k--", lw=0.8, label="finger")
    axes.plot(*path.T, color=_PATH_COLOUR, lw=1.5, label="contact point")
    axes.plot(*path[0], "o", color=_PATH_COLOUR, ms=5)
    axes.set(xlabel="X at displacement 0 (mm)", ylabel="Y at displacement 0 (mm)")
    axes.set(xlim=extent[:2], ylim=extent[2:])
    axes.legend(loc="upper right", fontsize=8)


def surfaces_figure(surfaces: Mapping[str, Triangles], place_mm: Sequence[float]) -> Figure:
    """Draw surfaces by the tissue whose colour they get, and mark a place (3,) by a red ball."""
    import pyvista as pv

    from tactile_fem.output import scene

    figure = ShownFigure(figsize=_SIZE_INCHES, dpi=_DPI)
    for k, (name, eye) in enumerate(_EYES.items()):
        plotter = scene.new_plotter()
        for tissue, surface in surfaces.items():
            shape = pv.PolyData.from_regular_faces(surface.points, surface.triangles)
            plotter.add_mesh(shape, color=COLOURS[tissue], opacity=_OPACITIES.get(tissue, 1.0))
        ball = pv.Sphere(radius=_BALL_RADIUS_MM, center=place_mm)
        plotter.add_mesh(ball, color="red", lighting=False)
        scene.look_at(plotter, eye, (0.0, -2.0, 6.0), half_height_mm=16.0)
        _show(figure, (0.5 * k, 0.02, 0.5, 0.9), scene.shot(plotter, *_PIXELS), name)
    return figure


def _show(
    figure: Figure, box: Extent, image: NDArray[np.uint8], title: str, extent: Extent | None = None
) -> Axes:
    """Show an image in a box of the figure, with axes if its extent in mm is given."""
    axes = figure.add_axes(box)
    axes.imshow(image, extent=extent, interpolation="lanczos")
    axes.set_title(title, fontsize=10)
    if extent is None:
        axes.set_axis_off()
    return axes
