"""The contact of a pad with moving bodies: how skin yields and is dragged, pressures, slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from tactile_fem.errors import ConvergenceError
from tactile_fem.surrogate.heights import Grid, HeightMap

Array = NDArray[Any]

# Skin may be so far off a body; less where a force is sought, lest it jumps.
TOLERANCE_MM, FINE_MM = 3e-3, 1e-4
_ITERATIONS = 200
_NEAR_MM = 1.6  # of cells in the preconditioner
_TINY = np.float32(1e-20)


@dataclass(frozen=True)
class NormalResponse:
    """The skin's compliance along Z, taken from the finite elements about a pressed state.

    It is the motion into the finger at one cell by a pressure on another, symmetric.
    """

    grid: Grid  # cells of the skin
    cells: NDArray[np.int64]  # those that a body can press, (n,), as numbers of the grid's places
    compliance_mm_per_MPa: Array  # (n, n)

    @property
    def cell_mm2(self) -> float:
        """The area of a cell."""
        return self.grid.spacing_mm**2

    def press(
        self, overlap_mm: Array, start_MPa: Array, tolerance_mm: float = TOLERANCE_MM
    ) -> Array:
        """Return the pressures, (n, bodies), under bodies that overlap the undeformed skin.

        There is no friction. Where pressed, skin lies on the body within a tolerance; elsewhere it
        is clear of it. The pressures are found by conjugate gradients on the cells that press
        (Polonsky and Keer 1999, Wear 231:206), from a guess (n, bodies) on; `overlap_mm`,
        (n, bodies), is negative where they are apart.

        Raises ConvergenceError if skin of a body is not on it.
        """
        C, nearly = self.compliance_mm_per_MPa, self._near_inverse
        stiffest, p = C.diagonal().max(), start_MPa.copy()
        gap = C @ p - overlap_mm
        way = np.zeros_like(p)
        before, goes_on = np.ones_like(p[0]), np.zeros_like(p[0])
        found = np.zeros(p.shape[1], dtype=bool)
        for _ in range(_ITERATIONS):
            on = p > 0
            wrong = np.where(on, np.abs(gap), -gap)
            found |= wrong.max(axis=0, initial=0.0) < tolerance_mm
            if found.all():
                return p
            rest = np.where(on, gap, 0)
            guess = np.where(on, nearly @ rest, 0)
            square = (rest * guess).sum(axis=0)
            way = np.where(on, guess + goes_on * (square / np.maximum(before, _TINY)) * way, 0)
            before = square
            yields = C @ way
            step = (rest * way).sum(axis=0) / np.maximum((way * yields).sum(axis=0), _TINY)
            step[found] = 0  # so that each body is felt as it would be alone
            freed, touched = on & (p < step * way), ~on & (gap < 0) & ~found
            p = np.maximum(p - step * way, 0)
            gap = gap - step * yields
            if freed.any() or touched.any():
                p = np.where(touched, -gap / stiffest, p)
                p = np.maximum(p, 0)
                gap = C @ p - overlap_mm
            goes_on = np.where(touched.any(axis=0), 0, 1).astype(p.dtype)
        body = int(found.argmin())
        cell = int(wrong[:, body].argmax())
        x, y = self.grid.points_mm[self.cells[cell]]
        reason = f"skin at X {x:.1f}, Y {y:.1f} mm is {wrong[cell, body]:.2g} mm off the body"
        raise ConvergenceError(
            f"the contact is not found in {_ITERATIONS} iterations ({reason}); try less depth or a "
            "smoother body",
            np.full(3, np.nan),
            reason,
        )

    @cached_property
    def _near_inverse(self) -> sparse.csr_array:
        """The inverse of the compliance between cells beside each other: a preconditioner."""
        inverse = np.linalg.inv(self.compliance_mm_per_MPa.astype(float))
        places = self.grid.points_mm[self.cells]
        near = np.linalg.norm(places[:, None] - places[None], axis=2) <= _NEAR_MM
        kept = np.where(near, inverse, 0.0)
        # What is left out is added to the diagonal, so that it stays positive definite.
        kept += np.diag(np.abs(np.where(near, 0.0, inverse)).sum(axis=1))
        return sparse.csr_array((kept + kept.T) / 2).astype(np.float32)


_LEAST_MM = 1e-6


@dataclass(frozen=True)
class TangentialResponse:
    """The drag of sliding skin, ``mu c N^a`` along the slip; fitted to scans."""

    compliance_mm_per_N: float  # c along Y
    exponent: float  # a, of the normal force N
    across: float  # drag along X over that along Y

    def limit_mm(self, friction: Array, normal_N: Array) -> Array:
        """Return how far sliding skin is dragged along Y."""
        return friction * self.compliance_mm_per_N * np.maximum(normal_N, 0.0) ** self.exponent

    def slid(self, slip: Array, moved_mm: Array, limit_mm: Array) -> Array:
        """Return how the skin slips, (..., 2), after a displacement of the body, (..., 2).

        The length of the slip is 0 where skin sticks unstrained and 1 where all of it slides; the
        limits are (...,).
        """
        length = np.linalg.norm(moved_mm, axis=-1, keepdims=True)
        left = np.exp(-length / np.maximum(limit_mm[..., None], _LEAST_MM))
        return left * slip + (1 - left) * moved_mm / np.maximum(length, _LEAST_MM)

    def of(self, slip: Array, limit_mm: Array) -> Array:
        """Return the drag in mm, (..., 2)."""
        return limit_mm[..., None] * slip * np.array([self.across, 1.0])


# Farther from the skin a body is as good as absent.
_APART_MM = -0.8
# Velocities are given as the way in this time, some time constant of the tissue's viscosity.
_LEAD_S = 0.004
_DRAGGED_MM = 2.0  # skin is dragged by no more


@dataclass(frozen=True)
class Pad:
    """The undeformed pad, and how it yields."""

    grid: Grid  # places over which heights are read
    skin_mm: Array  # Z of the undeformed skin there, (places,)
    normal: NormalResponse  # its cells are places of the grid as well
    tangential: TangentialResponse  # how friction drags it along

    def meets(self, places_mm: Array) -> tuple[Array, Array]:
        """Return the least and the largest X and Y, in its frame, of what it meets of a body.

        `places_mm` are the body's places in turn, (n, 2).
        """
        reach = self.grid.points_mm
        low = reach.min(axis=0) - places_mm.max(axis=0) - _DRAGGED_MM
        return low, reach.max(axis=0) - places_mm.min(axis=0) + _DRAGGED_MM

    def under_cells(self) -> NDArray[np.int64]:
        """Return the places of the grid at the cells of the response, (cells,)."""
        cells = self.normal.grid.points_mm[self.normal.cells]
        steps = np.round((cells - self.grid.low_mm) / self.grid.spacing_mm).astype(np.int64)
        return np.ravel_multi_index(tuple(steps.T), self.grid.shape)

    @cached_property
    def is_covered(self) -> NDArray[np.bool_]:
        """Whether places of the grid are at a cell, (places,)."""
        cells = KDTree(self.normal.grid.points_mm[self.normal.cells])
        return np.less_equal(cells.query(self.grid.points_mm)[0], self.normal.grid.spacing_mm)

    def symmetric(self) -> Pad:
        """Return the mean of the pad and its mirror image in X."""
        grid, own, C = self.normal.grid, self.normal.cells, self.normal.compliance_mm_per_MPa
        mirrored = np.arange(len(grid.points_mm)).reshape(grid.shape)[::-1].ravel()
        cells = np.intersect1d(own, mirrored[own])
        one, other = (np.searchsorted(own, each) for each in (cells, mirrored[cells]))
        C = (C[np.ix_(one, one)] + C[np.ix_(other, other)]) / 2
        skin = self.skin_mm.reshape(self.grid.shape)
        mean = ((skin + skin[::-1]) / 2).ravel()
        return replace(self, skin_mm=mean, normal=NormalResponse(grid, cells, C))


class ContactPatch:
    """The contact of one pad with bodies, each on its own.

    Coefficients of `friction` are (bodies,), `places_mm` at first (bodies, 3).
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
        self._under, self._cells = pad.under_cells(), pad.normal.cells
        self._slip, self._drag = np.zeros((count, 2)), np.zeros((count, 2))
        self._lead = np.zeros((count, 3))
        self._pressed = np.zeros((len(self._cells), count), np.float32)
        # How deep each body lies in the undeformed pad, dragged along, (bodies, places).
        self.overlap_mm = np.full((count, len(pad.skin_mm)), np.float32(_APART_MM))
        # On the cells of the response's grid, (bodies, cells), and their sums, (bodies,).
        self.pressure_MPa = np.zeros((count, len(pad.normal.grid.points_mm)), np.float32)
        self.normal_N = np.zeros(count)
        # Whether bodies lie deepest in skin of which the response has no cells, (bodies,).
        self.is_off = np.zeros(count, bool)

    def move(self, places_mm: Array, dt_s: float) -> None:
        """Move the bodies to places (bodies, 3) within a time above 0.

        A shallow copy keeps the state before: no array is changed in place.
        """
        moved = places_mm - self._places
        drag = self._pad.tangential
        limit = drag.limit_mm(self._friction, self.normal_N)
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
        response = self._pad.normal
        overlap = np.ascontiguousarray(self.overlap_mm[:, self._under].T)
        self._pressed = response.press(overlap, self._pressed, self._tolerance_mm)
        self.pressure_MPa = np.zeros_like(self.pressure_MPa)
        self.pressure_MPa[:, self._cells] = self._pressed.T
        self.normal_N = self._pressed.sum(axis=0, dtype=float) * response.cell_mm2
        off_cells = np.where(self._pad.is_covered, 0.0, self.overlap_mm).max(axis=1)
        self.is_off = off_cells > np.maximum(overlap.max(axis=0), 0.0)

    def whole(self) -> Array:
        """Return what is the same for all receptors, (bodies, `WHOLE`)."""
        friction, depth_mm = self._friction[:, None], self._places[:, 2]
        sliding = self._slip, self._drag, friction, friction * self._slip
        return np.column_stack([*sliding, self._lead, self.normal_N, depth_mm])

    def measures(self) -> Array:
        """Return what a finger must have been made from, (bodies, `WHOLE` and largest pressure)."""
        return np.column_stack([self.whole(), self.pressure_MPa.max(axis=1)])


# Columns of `ContactPatch.whole`, and those that change sign with X.
WHOLE = (
    "slip_x", "slip_y", "drag_x_mm", "drag_y_mm", "friction", "friction_x", "friction_y",
    "lead_x_mm", "lead_y_mm", "lead_z_mm", "normal_N", "depth_mm",
)  # fmt: skip
ACROSS = tuple(name.split("_")[1] == "x" if "_" in name else False for name in WHOLE)
