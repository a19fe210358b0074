"""A picture of finger and stimulator before a scan: from the side, and the way from above.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyvista as pv
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.scans import Scans
from tactile_fem.output import drawing
from tactile_fem.path import Path
from tactile_fem.stimulus import RigidBody

# Shown around the way of the contact point, from above.
_MARGIN_MM = 11.0
_WIDE, _SQUARE = (1200, 1050), (1050, 1050)
# Scans from two sides, and the ball that marks a place of them.
_VIEWS = {"From the side": (40.0, -10.0, 12.0), "From the pad": (10.0, -6.0, -40.0)}
_COLOUR_OF = {"skin": "stratum_corneum"}
_MARK_MM = 0.6


def preview_figure(finger: FingerMesh, body: RigidBody, path: Path) -> Figure:
    """Draw the finger cut open at X = 0 on the body where it starts, and the body from above.

    Parameters
    ----------
    finger, body, path
        As a scan takes them.
    """
    places = path.places_mm()
    surface = drawing.body_surface(body, places)
    surface["height_mm"] = surface.points[:, 2]
    figure = Figure(figsize=(11.5, 5.2), dpi=150)
    side = figure.add_axes((0.0, 0.1, 0.5, 0.82))
    side.imshow(_from_the_side(finger, surface.translate(places[0])), interpolation="lanczos")
    side.set_axis_off()
    side.set_title("Where it starts, cut at X = 0", fontsize=10)
    _draw_from_above(figure, finger, surface, places)
    handles = [
        Patch(color=colour, label=name.replace("_", " "))
        for name, colour in drawing.COLOURS.items()
    ]
    figure.legend(handles=handles, loc="lower left", ncols=6, frameon=False, fontsize=8)
    return figure


def scans_figure(scans: Scans, place_mm: Sequence[float]) -> Figure:
    """Draw the scanned surfaces of a finger in its axes, and a place at which they do not fit.

    Parameters
    ----------
    scans
        Skin, bone and nail.
    place_mm
        (3,), marked by a red ball.
    """
    figure = Figure(figsize=(11.5, 5.2), dpi=150)
    for k, (name, from_where) in enumerate(_VIEWS.items()):
        plotter = drawing.off_screen(_SQUARE)
        for part, opacity in (("skin", 0.35), ("bone", 1.0), ("nail", 0.7)):
            surface = getattr(scans, part)
            if surface is not None:
                colour = drawing.COLOURS[_COLOUR_OF.get(part, part)]
                shape = pv.PolyData.from_regular_faces(surface.points, surface.triangles)
                plotter.add_mesh(shape, color=colour, opacity=opacity)
        plotter.add_mesh(pv.Sphere(radius=_MARK_MM, center=place_mm), color="red", lighting=False)
        image = drawing.picture(plotter, from_where, (0.0, -2.0, 6.0), half_height=16.0)
        axes = figure.add_axes((0.5 * k, 0.02, 0.5, 0.9))
        axes.imshow(image, interpolation="lanczos")
        axes.set_axis_off()
        axes.set_title(name, fontsize=10)
    return figure


def _from_the_side(finger: FingerMesh, stimulator: pv.PolyData) -> NDArray[np.uint8]:
    solid = pv.UnstructuredGrid({pv.CellType.TETRA: finger.cells[:, :4]}, finger.nodes)
    solid["tissue"] = finger.tissue
    plotter = drawing.off_screen(_WIDE)
    for name, part in drawing.parts(solid):
        colour = drawing.COLOURS[name]
        shell = part.extract_surface(algorithm=None).clip("x", origin=(0, 0, 0))
        if shell.n_points:
            plotter.add_mesh(shell, color=colour, ambient=0.25)
        face = part.slice("x", origin=(-1e-4, 0, 0))
        if face.n_points:
            plotter.add_mesh(face, color=colour, lighting=False)
            plotter.add_mesh(drawing.rim(face, (0.03, 0, 0)), **drawing.RIM_STYLE)
    drawing.add_stimulator(plotter, stimulator)
    return drawing.picture(plotter, (30.0, -9.0, 17.0), (0.0, -0.5, 3.0), half_height=11.0)


def _draw_from_above(
    figure: Figure, finger: FingerMesh, surface: pv.PolyData, places: NDArray[np.float64]
) -> None:
    """Draw a body's heights, in its own frame, and the way of the contact point over it."""
    way = -places[:, :2]
    middle = (way.min(axis=0) + way.max(axis=0)) / 2
    half = float(np.ptp(way, axis=0).max() / 2 + _MARGIN_MM)
    plotter = drawing.off_screen(_SQUARE)
    drawing.add_stimulator(plotter, surface)
    plotter.camera_position = [(*middle, 100.0), (*middle, 0.0), (0.0, 1.0, 0.0)]
    image = drawing.shot(plotter, half)
    axes = figure.add_axes((0.56, 0.16, 0.42, 0.74))
    x, y = middle
    axes.imshow(image, extent=(x - half, x + half, y - half, y + half), interpolation="lanczos")
    outline = finger.nodes[:, :2]
    outline = outline[ConvexHull(outline).vertices]
    start = way[0]
    axes.plot(*np.vstack([outline, outline[:1]]).T + start[:, None], "k--", lw=0.8, label="finger")
    axes.plot(*way.T, color="#C8553D", lw=1.5, label="contact point")
    axes.plot(*start, "o", color="#C8553D", ms=5)
    axes.set(
        xlim=(x - half, x + half),
        ylim=(y - half, y + half),
        xlabel="X at displacement 0 (mm)",
        ylabel="Y at displacement 0 (mm)",
        title="From above: where the contact point goes",
    )
    axes.title.set_fontsize(10)
    axes.legend(loc="upper right", fontsize=8)
