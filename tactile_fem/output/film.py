"""Frames of a scan: the finger, the epidermis-dermis interface and the receptors on it.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.finger.simplex import facets_of
from tactile_fem.output import drawing
from tactile_fem.output.histories import at_time
from tactile_fem.output.timeline import Timeline
from tactile_fem.runtime.logs import counted
from tactile_fem.simulation.fields import read_series
from tactile_fem.simulation.results import Results

# Frames from one saved state to the next.
_BETWEEN = 4
# Distance from the receptors to the cut behind them.
_BEHIND_MM = 0.15
# The interface is shown up to this height above its lowest point, or above the receptors.
_BOWL_MM, _MARGIN_MM = 2.3, 0.2
# Colour and radius in mm.
_SILENT, _FIRING = ("#101010", 0.07), ("#FFFFFF", 0.1)
_RIM_SHIFT_MM = (0.0, 0.03, 0.03)
# Of the interface. The first population that feels one of them tells which is shown.
_SIDES = ("epidermis", "dermis")
# Facets of the interface over the pad have a downward normal component of at least this.
_DOWN = 0.3

Piece = tuple[str, pv.DataSet, dict[str, Any]]


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
        (receptors, 3) deformed positions.
    fired
        (receptors,) whether they have fired since the previous frame.
    stimulator
        Its surface at its current position.
    """

    time_s: float
    displacement_mm: float
    solid: pv.UnstructuredGrid
    interface: pv.PolyData
    receptors_mm: NDArray[np.float64]
    fired: NDArray[np.bool_]
    stimulator: pv.PolyData


class Film:
    """Frames of a scan: the saved states and linear interpolations in time between them.

    Raises
    ------
    StudyError
        There are no field files, or they cannot be used.

    Attributes
    ----------
    displacement_mm
        (frames,).
    label, along
        What the frames are sorted by, displacement or time, and its values, (frames,).
    cut_mm
        Y of the cut in the undeformed finger.
    rim_mm
        Height up to which the undeformed interface is shown.
    top_kPa
        Upper end of the colour scale: 0.2 % of the interface exceed this strain energy density.
    strongest
        Number of the frame with the largest value of it.
    bar, camera
        See `tactile_fem.output.view.Frames`.
    """

    bar = "interface", "Strain energy density\non the interface (kPa)"

    def __init__(self, results: Results) -> None:
        written_s, self._files = read_series(results.fields)
        if not self._files:
            raise StudyError(f"There are no field files in {results.fields}: nothing to view.")
        self._results, self._trace = results, results.trace
        self._surface = drawing.stimulator_surface(results)
        every = results.study.populations
        sides = [one.receptors.side for one in every if one.receptors.side in _SIDES]
        self._interface = _interface(_read(self._files[0]), sides[0] if sides else _SIDES[0])
        places = self._trace["receptors_mm"]
        _, self._feet = self._interface.find_closest_cell(places, return_closest_point=True)
        for one in every:
            if one.receptors.below_skin_mm is not None:
                deep = results.receptors_of(one.name)
                self._feet[deep] = places[deep]
        self._timeline = timeline = Timeline.of(results, written_s, _BETWEEN)
        self.displacement_mm = timeline.displacement_mm
        self.label, self.along = timeline.label, timeline.along
        self.cut_mm = float(places[:, 1].min()) - _BEHIND_MM
        highest = float(places[:, 2].max()) + _MARGIN_MM
        self.rim_mm = max(self._interface.bounds.z_min + _BOWL_MM, highest)
        files = counted(self._files, "saved states to read")
        tops = [np.percentile(self._felt(_read(file))["sed_kPa"], 99.8) for file in files]
        self.top_kPa = max(*tops, 1e-6)
        focus = (0.0, self.cut_mm + 0.5, 3.6)
        self.camera = (9.0, self.cut_mm + 28.0, 24.0), focus, 9.6
        self.strongest = _BETWEEN * int(np.argmax(tops))

    def __len__(self) -> int:
        return len(self._timeline)

    def nearest(self, value: float) -> int:
        """Return the number of the frame nearest to a value of `along`."""
        return self._timeline.nearest(value)

    def __getitem__(self, k: int) -> State:
        time = self._timeline.times_s[k]
        solid = self._fields(k)
        translation = at_time(self._trace, "stimulator_mm", time)
        moved = pv.PolyData(self._feet).sample(solid, snap_to_closest_point=True)
        return State(
            time_s=float(time),
            displacement_mm=float(self.displacement_mm[k]),
            solid=solid,
            interface=self._felt(solid),
            receptors_mm=self._trace["receptors_mm"] + moved["displacement_mm"],
            fired=self._timeline.fired(self._results, k),
            stimulator=self._surface.translate(translation),
        )

    def pieces(self, k: int) -> Iterator[Piece]:
        """Yield everything to be drawn of frame `k`: a name, a mesh and its style."""
        state = self[k]
        cut = (0.0, self.cut_mm, 0.0)
        for name, part in drawing.parts(state.solid):
            colour = drawing.COLOURS[name]
            shell = part.extract_surface(algorithm=None).clip("y", origin=cut)
            if shell.n_points:
                yield f"{name} shell", drawing.deformed(shell), {"color": colour, "ambient": 0.25}
            face = part.slice("y", origin=cut)
            if face.n_points:
                face = drawing.deformed(face)
                yield f"{name} face", face, {"color": colour, "lighting": False}
                yield f"{name} rim", drawing.rim(face, _RIM_SHIFT_MM), drawing.RIM_STYLE
        front = state.interface.clip("y", origin=cut, invert=False)
        front = drawing.deformed(front.clip("z", origin=(0.0, 0.0, self.rim_mm)))
        style = {
            "scalars": "sed_kPa",
            "cmap": drawing.SCALE,
            "clim": (0, self.top_kPa),
            "lighting": False,
        }
        yield "interface", front, style
        yield "interface rim", drawing.rim(front, _RIM_SHIFT_MM), drawing.RIM_STYLE
        for name, which, (colour, radius) in (
            ("silent", ~state.fired, _SILENT),
            ("firing", state.fired, _FIRING),
        ):
            points = pv.PolyData(state.receptors_mm[which])
            balls = points.glyph(geom=pv.Sphere(radius=radius), scale=False, orient=False)
            yield name, balls, {"color": colour, "ambient": 0.4}
        yield "stimulator", state.stimulator, drawing.RELIEF_STYLE

    def title(self, k: int) -> str:
        """Return what is written over frame `k`."""
        time_ms = 1000 * self._timeline.times_s[k]
        return f"Displacement {self.displacement_mm[k]:.1f} mm, {time_ms:.0f} ms"

    @property
    def legend(self) -> dict[str, str]:
        """Colours by what they mean."""
        layers = {name.replace("_", " "): colour for name, colour in drawing.COLOURS.items()}
        return {**layers, "receptor, silent": _SILENT[0], "receptor, firing": _FIRING[0]}

    def _fields(self, k: int) -> pv.UnstructuredGrid:
        """Return the undeformed tetrahedra with the fields of frame `k`."""
        before, share = divmod(k, _BETWEEN)
        grid = _read(self._files[before])
        solid = drawing.linear(grid, grid.points)
        solid["displacement_mm"] = grid["displacement_mm"]
        if share:
            after = _read(self._files[before + 1])
            for name in ("displacement_mm", "sed_kPa"):
                solid[name] = solid[name] + share / _BETWEEN * (after[name] - solid[name])
        return solid

    def _felt(self, grid: pv.UnstructuredGrid) -> pv.PolyData:
        """Return the interface with ``displacement_mm`` and ``sed_kPa`` at its nodes."""
        surface = self._interface.copy()
        surface["displacement_mm"] = grid["displacement_mm"][surface["node"]]
        surface.cell_data["sed_kPa"] = grid["sed_kPa"][surface["owner"]]
        return surface.cell_data_to_point_data()


def _interface(grid: pv.UnstructuredGrid, side: str) -> pv.PolyData:
    """Return the facets between epidermis and dermis that face the stimulator.

    Points know their ``node`` in the grid, facets their ``owner``: the cell on the given side,
    whose strain energy density is shown.
    """
    facets, *pair = facets_of(grid.cells.reshape(-1, 11)[:, 1:5])
    tissues = np.where(np.array(pair) >= 0, grid["tissue"][np.array(pair)], 0)
    between = np.sort(tissues, axis=0).T == (TISSUES["epidermis"], TISSUES["dermis"])
    a, b, c = np.moveaxis(grid.points[facets], 1, 0)
    normal = np.cross(b - a, c - a)  # out of the first cell of the pair
    inward = np.where(tissues[0] == TISSUES["epidermis"], 1, -1)
    down = inward * normal[:, 2] / np.linalg.norm(normal, axis=1)
    chosen = between.all(axis=1) & (down > _DOWN)
    if not chosen.any():
        raise StudyError("The fields have no interface between epidermis and dermis to view.")
    nodes, corners = np.unique(facets[chosen], return_inverse=True)
    surface = pv.PolyData.from_regular_faces(grid.points[nodes], corners.reshape(-1, 3))
    surface.point_data["node"] = nodes
    surface.cell_data["owner"] = np.where(tissues[0] == TISSUES[side], *pair)[chosen]
    return surface


def _read(path: Path) -> pv.UnstructuredGrid:
    """Return a saved state; raise StudyError if the file is no such state."""
    with suppress(OSError, ValueError, ET.ParseError):
        ET.parse(path)  # VTK prints long messages about damaged files
        grid = pv.read(path)
        if all(name in grid.array_names for name in ("displacement_mm", "sed_kPa", "tissue")):
            return grid
    raise StudyError(f"{path} cannot be read as a field file of a scan.")
