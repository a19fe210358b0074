"""The pressed finger as an elastic cushion: how the skin yields, and the pressures of contact."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from tactile_fem.errors import ConvergenceError
from tactile_fem.surrogate.grid import Grid

Array = NDArray[Any]

# Skin may be so far off a body; less where a force is sought, lest it jumps.
TOLERANCE_MM, FINE_MM = 3e-3, 1e-4
_ITERATIONS = 200
_NEAR_MM = 1.6  # of cells in the preconditioner
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

    def press(
        self, overlap_mm: Array, start_MPa: Array, tolerance_mm: float = TOLERANCE_MM
    ) -> Array:
        """Return the pressures under bodies that overlap the undeformed skin, without friction.

        Where pressed, skin lies on the body; elsewhere it is clear of it. The pressures are found
        by conjugate gradients on the cells that press (Polonsky and Keer 1999, Wear 231:206).

        Parameters
        ----------
        overlap_mm
            (n, bodies); negative where they are apart.
        start_MPa
            A guess, (n, bodies).
        tolerance_mm
            Of the skin's place.

        Raises
        ------
        ConvergenceError
            Skin of a body is not on it.
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
