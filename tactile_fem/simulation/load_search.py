"""The place of the body at which several loads are met at once.

Plain numbers: it knows nothing of finite elements.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Share of the whole load by which loads may be missed; as much may be where there is hardly any.
TOLERANCE, _NEGLIGIBLE_N = 1e-3, 1e-6
# Solves in which loads have to be met, and how many are usual.
_MOST_SOLVES, _USUAL_SOLVES = 9, 4


@dataclass
class LoadSearch:
    """The place `x` of the body at which its loads are those sought: Broyden's method.

    Loads are in N and places in mm; torques and angles are divided and multiplied by an arm.

    Parameters
    ----------
    x
        Place at the first solve, then at the next one, (k,).
    stiffness
        Change of the loads over that of the place as far as it is known, (k, k), N/mm; updated.
    longest_mm
        Longest way between two solves.
    """

    x: Array
    stiffness: Array
    longest_mm: float
    solves: int = 0  # their number so far
    _last: tuple[Array, Array] | None = field(default=None, repr=False)

    def is_met(self, excess_N: Array, scale_N: float) -> bool:
        """Return whether loads exceed those sought by nearly nothing; if not, move `x`.

        `scale_N` is the size of the whole load.
        """
        x, self.solves = self.x, self.solves + 1
        if self._last is not None:
            self._learn(x - self._last[0], excess_N - self._last[1])
        self._last = x, excess_N
        if np.linalg.norm(excess_N) <= max(TOLERANCE * scale_N, _NEGLIGIBLE_N):
            return True
        self.x = x + way_to(-excess_N, self.stiffness, self.longest_mm)
        return False

    def _learn(self, way_mm: Array, gained_N: Array) -> None:
        if square := float(way_mm @ way_mm):
            missed = gained_N - self.stiffness @ way_mm
            self.stiffness = self.stiffness + np.outer(missed, way_mm) / square

    @property
    def is_slow(self) -> bool:
        """Whether it takes more solves than usual."""
        return self.solves >= _USUAL_SOLVES

    @property
    def has_failed(self) -> bool:
        """Whether it has taken too many solves."""
        return self.solves >= _MOST_SOLVES


def way_to(gain_N: Array, stiffness: Array, longest_mm: float) -> Array:
    """Return a way of the body that changes the loads by so much, at most the longest one, (k,)."""
    way_mm: Array = np.linalg.lstsq(stiffness, gain_N, rcond=1e-6)[0]
    length = float(np.linalg.norm(way_mm))
    return way_mm * min(1.0, longest_mm / length) if length else way_mm
