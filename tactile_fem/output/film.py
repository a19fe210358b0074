"""Frames of a scan: the finger, the epidermis-dermis interface and the receptors on it.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import TISSUES, facets_of
from tactile_fem.output import drawing
from tactile_fem.output.pictures import at_time
from tactile_fem.scan.fields import read_series
from tactile_fem.scan.results import Results

# Frames from one saved state to the next.
_BETWEEN = 4
# Distance from the receptors to the cut behind them.
_BEHIND_MM = 0.15
# The interface is shown up to this height above its lowest point, or above the receptors.
_BOWL_MM, _MARGIN_MM = 2.3, 0.2
# Facets of the interface over the pad have a downward normal component of at least this.
_DOWN = 0.3


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
        (frames,) of the slide.
    cut_mm
        Y of the cut in the undeformed finger.
    rim_mm
        Height up to which the undeformed interface is shown.
    top_kPa
        Upper end of the colour scale: 0.2 % of the interface exceed this strain energy density.
    strongest
        Number of the frame with the largest value of it.
    """

    def __init__(self, results: Results) -> None:
        self._written_s, self._files = read_series(results.fields)
        if not self._files:
            raise StudyError(f"There are no field files in {results.fields}: nothing to view.")
        self._trace, self._spikes = results.trace, results.spikes
        self._surface = drawing.stimulator_surface(results)
        self._interface = Interface(
            _read(self._files[0]), results.study.populations[0].receptors.side
        )
        self._anchors = self._interface.anchors(self._trace["receptors_mm"])
        frames = np.arange(_BETWEEN * (len(self._files) - 1) + 1) / _BETWEEN
        self._times_s = np.interp(frames, np.arange(len(self._files)), self._written_s)
        step = self._times_s[1] - self._times_s[0] if len(frames) > 1 else np.inf
        self._since_s = np.concatenate([self._times_s[:1] - step, self._times_s[:-1]])
        self.displacement_mm = at_time(self._trace, "displacement_mm", self._times_s)
        self.cut_mm = float(self._trace["receptors_mm"][:, 1].min()) - _BEHIND_MM
        highest = float(self._trace["receptors_mm"][:, 2].max()) + _MARGIN_MM
        self.rim_mm = max(self._interface.lowest_mm + _BOWL_MM, highest)
        tops = [np.percentile(self._interface.sed_kPa(_read(p)), 99.8) for p in self._files]
        self.top_kPa = max(*tops, 1e-6)
        self.strongest = _BETWEEN * int(np.argmax(tops))

    def __len__(self) -> int:
        return len(self._times_s)

    def nearest(self, displacement_mm: float) -> int:
        """Return the number of the frame nearest to a displacement."""
        return int(np.argmin(np.abs(self.displacement_mm - displacement_mm)))

    def __getitem__(self, k: int) -> State:
        time = self._times_s[k]
        solid = self._fields(k)
        interface = self._interface.of(solid)
        recent = (self._spikes.time_s > self._since_s[k]) & (self._spikes.time_s <= time)
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
            stimulator=self._surface.translate(translation),
        )

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


class Interface:
    """The facets between epidermis and dermis that face the stimulator.

    Parameters
    ----------
    grid
        Quadratic tetrahedra with ``tissue``.
    side
        Tissue whose strain energy density is shown.
    """

    def __init__(self, grid: pv.UnstructuredGrid, side: str) -> None:
        tets = grid.cells.reshape(-1, 11)[:, 1:5]
        facets, *cells = facets_of(tets)
        tissues = np.where(np.array(cells) >= 0, grid["tissue"][np.array(cells)], 0)
        epidermis, dermis = (
            np.where(tissues[0] == TISSUES[name], *cells) for name in ("epidermis", "dermis")
        )
        between = np.sort(tissues, axis=0).T == (TISSUES["epidermis"], TISSUES["dermis"])
        centres = grid.points[tets].mean(axis=1)
        a, b, c = np.moveaxis(grid.points[facets], 1, 0)
        normal = np.cross(b - a, c - a)
        outward = np.sign(((centres[epidermis] - centres[dermis]) * normal).sum(axis=1))
        down = -outward * normal[:, 2] / np.linalg.norm(normal, axis=1)
        chosen = between.all(axis=1) & (down > _DOWN)
        if not chosen.any():
            raise StudyError("The fields have no interface between epidermis and dermis to view.")
        owner = (epidermis if side == "epidermis" else dermis)[chosen]
        self._nodes, corners = np.unique(facets[chosen], return_inverse=True)
        self._corners = corners.reshape(-1, 3)
        self._owner = owner
        self._rest = pv.PolyData.from_regular_faces(grid.points[self._nodes], self._corners)

    @property
    def lowest_mm(self) -> float:
        """Height of its lowest point."""
        return float(self._rest.bounds.z_min)

    def sed_kPa(self, grid: pv.UnstructuredGrid) -> NDArray[np.float64]:
        """Return the strain energy density at the nodes: the mean of the adjacent facets."""
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
        """Attach undeformed points to their nearest facets."""
        facet, foot = self._rest.find_closest_cell(places_mm, return_closest_point=True)
        a, b, c = np.moveaxis(self._rest.points[self._corners[facet]], 1, 0)
        edges = np.stack([b - a, c - a], axis=2)
        local = np.einsum("pij,pj->pi", np.linalg.pinv(edges), foot - a)
        weights = np.column_stack([1 - local.sum(axis=1), local])
        return Anchors(self._corners[facet], weights, places_mm - foot)


@dataclass(frozen=True)
class Anchors:
    """Points that move with a surface.

    Attributes
    ----------
    nodes, weights
        (n, 3) corners of the facet nearest to each point, and barycentric coordinates in it.
    offset_mm
        (n, 3) from there to the point.
    """

    nodes: NDArray[np.int64]
    weights: NDArray[np.float64]
    offset_mm: NDArray[np.float64]

    def follow(self, surface: pv.PolyData) -> NDArray[np.float64]:
        """Return the deformed positions of the points, (n, 3) mm."""
        corners = deformed(surface).points[self.nodes]
        return np.einsum("pc,pci->pi", self.weights, corners) + self.offset_mm


def _read(path: Path) -> pv.UnstructuredGrid:
    """Return a saved state; raise StudyError if the file is no such state."""
    with suppress(OSError, ValueError, ET.ParseError):
        ET.parse(path)  # VTK prints long messages about damaged files
        grid = pv.read(path)
        if all(name in grid.array_names for name in ("displacement_mm", "sed_kPa", "tissue")):
            return grid
    raise StudyError(f"{path} cannot be read as a field file of a scan.")


def deformed(mesh: pv.PolyData) -> pv.PolyData:
    """Return a surface moved by its ``displacement_mm``."""
    moved = mesh.copy()
    moved.points = mesh.points + mesh["displacement_mm"]
    return moved
