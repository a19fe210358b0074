"""The contact of the pad with moving bodies, step by step: overlaps, pressures, slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tactile_fem.surrogate.cushion import TOLERANCE_MM, Cushion
from tactile_fem.surrogate.drag import Drag
from tactile_fem.surrogate.grid import Grid
from tactile_fem.surrogate.heights import HeightMap

Array = NDArray[Any]

# Farther from the skin a body is as good as absent.
_APART_MM = -0.8
# Velocities are given as the way in this time, some time constant of the tissue's viscosity.
_LEAD_S = 0.004
_DRAGGED_MM = 2.0  # skin is dragged by no more


@dataclass(frozen=True)
class Pad:
    """The undeformed pad, and how it yields.

    Attributes
    ----------
    grid
        Places over which heights are read.
    skin_mm
        Z of the undeformed skin there, (places,).
    cushion
        Its compliance; its cells are places of the grid as well.
    drag
        How friction drags it along.
    """

    grid: Grid
    skin_mm: Array
    cushion: Cushion
    drag: Drag

    def meets(self, places_mm: Array) -> tuple[Array, Array]:
        """Return the least and the largest X and Y, in its frame, of what it meets of a body.

        Parameters
        ----------
        places_mm
            Where the body is in turn, (n, 2).
        """
        reach = self.grid.points_mm
        low = reach.min(axis=0) - places_mm.max(axis=0) - _DRAGGED_MM
        return low, reach.max(axis=0) - places_mm.min(axis=0) + _DRAGGED_MM

    def under_cells(self) -> NDArray[np.int64]:
        """Return the places of the grid at the cells of the cushion, (cells,)."""
        x, y = self.cushion.grid.points_mm[self.cushion.cells].T
        i, j = (
            np.round((at - low) / self.grid.spacing_mm).astype(np.int64)
            for at, low in zip((x, y), self.grid.low_mm, strict=True)
        )
        return i * self.grid.shape[1] + j

    @cached_property
    def is_covered(self) -> NDArray[np.bool_]:
        """Whether places of the grid are at a cell, (places,)."""
        cells = KDTree(self.cushion.grid.points_mm[self.cushion.cells])
        covered: NDArray[np.bool_] = (
            cells.query(self.grid.points_mm)[0] <= self.cushion.grid.spacing_mm
        )
        return covered

    def symmetric(self) -> Pad:
        """Return the mean of the pad and its mirror image in X."""
        grid, own, C = self.cushion.grid, self.cushion.cells, self.cushion.compliance_mm_per_MPa
        mirrored = np.arange(len(grid.points_mm)).reshape(grid.shape)[::-1].ravel()
        cells = np.intersect1d(own, mirrored[own])
        one, other = (np.searchsorted(own, each) for each in (cells, mirrored[cells]))
        C = (C[np.ix_(one, one)] + C[np.ix_(other, other)]) / 2
        skin = self.skin_mm.reshape(self.grid.shape)
        mean = ((skin + skin[::-1]) / 2).ravel()
        return replace(self, skin_mm=mean, cushion=Cushion(grid, cells, C))


class Touch:
    """The contact of one pad with bodies, each on its own.

    Parameters
    ----------
    pad
        The finger's.
    bodies
        What is touched.
    friction
        Coefficients, (bodies,).
    places_mm
        Where the bodies are at first, (bodies, 3).
    tolerance_mm
        See `Cushion.press`.

    Attributes
    ----------
    overlap_mm
        How deep each body lies in the undeformed pad, dragged along, (bodies, places); at least
        -0.8.
    pressure_MPa
        On the cells of the cushion's grid, (bodies, cells).
    normal_N
        Sum of the pressures, (bodies,).
    is_off
        Whether bodies lie deepest in skin of which the cushion has no cells, (bodies,).
    """

    def __init__(
        self,
        pad: Pad,
        bodies: Sequence[HeightMap],
        friction: Array,
        places_mm: Array,
        tolerance_mm: float = TOLERANCE_MM,
    ) -> None:
        self._tolerance_mm = tolerance_mm
        self._pad, self._bodies, self._friction = pad, bodies, np.asarray(friction, dtype=float)
        self._places, count = np.array(places_mm, dtype=float), len(bodies)
        self._under, self._cells = pad.under_cells(), pad.cushion.cells
        self._slip, self._drag = np.zeros((count, 2)), np.zeros((count, 2))
        self._lead = np.zeros((count, 3))
        self._pressed = np.zeros((len(self._cells), count), np.float32)
        self.overlap_mm = np.full((count, len(pad.skin_mm)), np.float32(_APART_MM))
        self.pressure_MPa = np.zeros((count, len(pad.cushion.grid.points_mm)), np.float32)
        self.normal_N = np.zeros(count)
        self.is_off = np.zeros(count, bool)

    def move(self, places_mm: Array, dt_s: float) -> None:
        """Move the bodies to places (bodies, 3) within a time above 0.

        A shallow copy keeps the state before: no array is changed in place.
        """
        moved = places_mm - self._places
        drag, limit = self._pad.drag, self._pad.drag.limit_mm(self._friction, self.normal_N)
        slip = drag.slid(self._slip, moved[:, :2], limit)
        self._slip = np.where(self.normal_N[:, None] > 0, slip, 0.0)
        self._drag = drag.of(self._slip, limit)
        self._lead = _LEAD_S * moved / dt_s
        self._places = np.array(places_mm, dtype=float)
        self._overlap()
        self._press()

    def _overlap(self) -> None:
        pad, overlap = self._pad, np.empty_like(self.overlap_mm)
        for k, body in enumerate(self._bodies):
            heights = body.over(pad.grid, self._places[k, :2] - self._drag[k])
            overlap[k] = self._places[k, 2] + heights.ravel() - pad.skin_mm
        self.overlap_mm = np.maximum(overlap, np.float32(_APART_MM))

    def _press(self) -> None:
        cushion = self._pad.cushion
        overlap = np.ascontiguousarray(self.overlap_mm[:, self._under].T)
        self._pressed = cushion.press(overlap, self._pressed, self._tolerance_mm)
        self.pressure_MPa = np.zeros_like(self.pressure_MPa)
        self.pressure_MPa[:, self._cells] = self._pressed.T
        self.normal_N = self._pressed.sum(axis=0, dtype=float) * cushion.cell_mm2
        off_cells = np.where(self._pad.is_covered, 0.0, self.overlap_mm).max(axis=1)
        self.is_off = off_cells > np.maximum(overlap.max(axis=0), 0.0)

    def whole(self) -> Array:
        """Return what is the same for all receptors, (bodies, `WHOLE`)."""
        friction = self._friction[:, None]
        columns = (
            self._slip,
            self._drag,
            friction,
            friction * self._slip,
            self._lead,
            self.normal_N[:, None],
            self._places[:, 2:],
        )
        return np.concatenate(columns, axis=1)


# Columns of `Touch.whole`, and those that change sign with X.
WHOLE = (
    "slip_x", "slip_y", "drag_x_mm", "drag_y_mm", "friction", "friction_x", "friction_y",
    "lead_x_mm", "lead_y_mm", "lead_z_mm", "normal_N", "depth_mm",
)  # fmt: skip
ACROSS = tuple(name.split("_")[1] == "x" if "_" in name else False for name in WHOLE)
