"""The pressed finger as an elastic cushion: how the skin yields, and the pressures of contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.surrogate.grid import Grid

Array = NDArray[Any]

_ITERATIONS, _TOLERANCE_MM = 60, 2e-3
_TINY = np.float32(1e-20)


@dataclass(frozen=True)
class Cushion:
    """The skin's compliance along Z, taken from the finite elements about a pressed state.

    Attributes
    ----------
    grid
        Cells of the skin.
    cells
        Those that a body can press, (n,), as numbers of the grid's places.
    compliance_mm_per_MPa
        Motion into the finger at one cell by a pressure on another, (n, n), symmetric.
    """

    grid: Grid
    cells: NDArray[np.int64]
    compliance_mm_per_MPa: Array

    @property
    def cell_mm2(self) -> float:
        """The area of a cell."""
        return self.grid.spacing_mm**2

    def press(self, overlap_mm: Array, start_MPa: Array) -> Array:
        """Return the pressures under bodies that overlap the undeformed skin, without friction.

        Where pressed, skin lies on the body; elsewhere it is clear of it. The pressures are found
        by conjugate gradients on the cells that press (Polonsky and Keer 1999, Wear 231:206).

        Parameters
        ----------
        overlap_mm
            (n, bodies); negative where they are apart.
        start_MPa
            A guess, (n, bodies).
        """
        C, p = self.compliance_mm_per_MPa, start_MPa.copy()
        way = np.zeros_like(p)
        before, goes_on = np.ones_like(p[0]), np.zeros_like(p[0])
        for _ in range(_ITERATIONS):
            gap = C @ p - overlap_mm
            on = p > 0
            wrong = np.where(on, np.abs(gap), -gap)
            if wrong.max(initial=0.0) < _TOLERANCE_MM:
                break
            rest = np.where(on, gap, 0)
            square = (rest * rest).sum(axis=0)
            way = np.where(on, gap + goes_on * (square / np.maximum(before, _TINY)) * way, 0)
            before = square
            along = np.maximum((way * (C @ way)).sum(axis=0), _TINY)
            step = (rest * way).sum(axis=0) / along
            p = np.maximum(p - step * way, 0)
            touched = (p == 0) & (gap < 0)
            length = np.where(step > 0, step, 1 / C[0, 0])
            p = np.where(touched, -length * gap, p)
            goes_on = np.where(touched.any(axis=0), 0, 1).astype(p.dtype)
        return p
