"""The layers of a solid finger in two cuts, along it and across it.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

import numpy as np
import pyvista as pv
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import TISSUES, FingerMesh
from tactile_fem.output.annotations import COLOURS, INK
from tactile_fem.output.plots import styled

Array = NDArray[np.float64]

_SIZE_INCHES, _MARGIN_MM, _BAR_MM, _LABELS_MM = (7.5, 3.0), 1.2, 5.0, 9.0
# Pieces of a cut are joined where they are this close, and lie beside faces of the mesh.
_JOIN_MM, _BESIDE_MM = 1e-4, 1e-3
# The ray on which the layers are named goes from the middle of the bone to the right and down.
_RAY = np.array([1.0, -1.0]) / np.sqrt(2)


@styled
def finger_figure(mesh: FingerMesh) -> Figure:
    """Draw the undeformed finger cut along X = 0 and across at Y = 0, its layers by name."""
    along, across = (cut(mesh, axis) for axis in (0, 1))
    spans = [_bounds(parts) for parts in (along, across)]
    widths = [high[0] - low[0] + 2 * _MARGIN_MM for low, high in spans]
    widths[1] += _LABELS_MM
    figure = Figure(figsize=_SIZE_INCHES, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True, width_ratios=widths)
    titles = "Along the finger, at X = 0", "Across it, at Y = 0"
    for axes, parts, (low, high), title in zip(panels, (along, across), spans, titles, strict=True):
        _draw(axes, parts)
        axes.set(aspect="equal", xlim=(low[0] - _MARGIN_MM, high[0] + _MARGIN_MM))
        axes.text(low[0], high[1] + _MARGIN_MM, title, fontsize=9)
        axes.set_axis_off()
    low, high = (np.array(ends) for ends in zip(*spans, strict=True))
    panels[0].set_ylim(low[:, 1].min() - 2.5 * _MARGIN_MM, high[:, 1].max() + 2.5 * _MARGIN_MM)
    panels[1].set_xlim(spans[1][0][0] - _MARGIN_MM, spans[1][1][0] + _MARGIN_MM + _LABELS_MM)
    _name_layers(panels[1], across, spans[1][1][0] + 2 * _MARGIN_MM)
    left, height = spans[0][0][0], low[:, 1].min() - _MARGIN_MM
    panels[0].plot([left, left + _BAR_MM], [height] * 2, color=INK, lw=2, solid_capstyle="butt")
    style = {"textcoords": "offset points", "ha": "center", "va": "top", "fontsize": 8}
    panels[0].annotate(f"{_BAR_MM:g} mm", (left + _BAR_MM / 2, height), (0, -3), **style)
    return figure


def cut(mesh: FingerMesh, axis: int) -> dict[str, shapely.Geometry]:
    """Return the shape of each tissue where the plane through the contact point cuts it.

    The plane is X = 0 (axis 0) with the coordinates Y and Z, or Y = 0 (axis 1) with X and Z.
    """
    normal = np.eye(3)[axis]
    parts = {}
    for name, tag in TISSUES.items():
        cells = mesh.cells[mesh.tissue == tag]
        if not len(cells):
            continue
        grid = pv.UnstructuredGrid({pv.CellType.TETRA: cells[:, :4]}, mesh.nodes)
        face = grid.slice(normal, origin=-_BESIDE_MM * normal)
        if not face.n_cells:
            continue
        places = np.delete(np.asarray(face.points, dtype=float), axis, axis=1)
        pieces = [shapely.Polygon(places[cell.point_ids]) for cell in face.cell]
        grown = shapely.union_all(shapely.buffer(pieces, _JOIN_MM, join_style="mitre"))
        parts[name] = shapely.buffer(grown, -_JOIN_MM, join_style="mitre")
    return parts


def _bounds(parts: dict[str, shapely.Geometry]) -> tuple[Array, Array]:
    bounds = shapely.total_bounds(list(parts.values()))
    return bounds[:2], bounds[2:]


def _draw(axes: Axes, parts: dict[str, shapely.Geometry]) -> None:
    for name, shape in parts.items():
        polygons = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
        rings = [ring for one in polygons for ring in (one.exterior, *one.interiors)]
        path = Path.make_compound_path(*(Path(ring.coords, closed=True) for ring in rings))
        axes.add_patch(PathPatch(path, facecolor=COLOURS[name], edgecolor=INK, lw=0.5))


def _name_layers(axes: Axes, parts: dict[str, shapely.Geometry], right: float) -> None:
    """Write the names of the layers at the right, each with a line to its layer."""
    middle = np.array((parts.get("bone") or next(iter(parts.values()))).centroid.coords[0])
    ray = shapely.LineString([middle, middle + 100 * _RAY])
    anchors = {}
    for name, shape in parts.items():
        on_ray = shape.intersection(ray)
        inside = on_ray.centroid if not on_ray.is_empty else shape.representative_point()
        anchors[name] = np.array(inside.coords[0])
    names = sorted(anchors, key=lambda name: -anchors[name][1])
    low, high = _bounds(parts)
    heights = np.linspace(high[1] - 0.5, low[1] + 0.5, len(names))
    for name, height in zip(names, heights, strict=True):
        line = {"arrowstyle": "-", "lw": 0.6, "color": INK, "shrinkA": 1, "shrinkB": 0}
        style = {"va": "center", "fontsize": 8, "arrowprops": line}
        axes.annotate(name.replace("_", " "), anchors[name], (right, height), **style)
        axes.plot(*anchors[name], "o", ms=2, color=INK)
