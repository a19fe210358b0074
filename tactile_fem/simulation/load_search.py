"""Search for the place of the body at which its loads are those wanted.

Plain numbers: it knows nothing of finite elements.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Share of the largest load by which loads may be missed; as much may be where there is hardly any.
TOLERANCE, _NEGLIGIBLE_N = 1e-3, 1e-6
# Solves after which a search for several loads has failed, one for a single load; slow from here.
_MAX_SOLVES, _MAX_SOLVES_OF_ONE, _USUAL_SOLVES = 9, 12, 4


@dataclass
class LoadSearch:
    """Finds the place `x` of the body at which its loads are those wanted, by Broyden's method.

    Loads are in N and places in mm; torques and angles are divided and multiplied by an arm. With
    one unknown, where this is the secant method, the place is kept between two at which the load is
    too small and too large, once they are known.

    Parameters
    ----------
    x
        Place at the first solve, then at the next one, (k,).
    stiffness
        Derivative of the loads with respect to the place as far as it is known, (k, k), N/mm;
        updated.
    max_increment_mm
        Longest distance between two solves.
    """

    x: Array
    stiffness: Array
    max_increment_mm: float
    solves: int = 0  # their number so far
    _last: tuple[Array, Array] | None = field(default=None, repr=False)
    # Of one unknown: the nearest places at which the load was too small, and too large.
    _bracket: dict[bool, float] = field(default_factory=dict, repr=False)

    def is_met(self, excess_N: Array, scale_N: float) -> bool:
        """Return whether the loads at `x` are those wanted; if not, move `x`.

        Parameters
        ----------
        excess_N
            Loads at `x` less those wanted, (k,).
        scale_N
            The largest load.
        """
        x, self.solves = self.x, self.solves + 1
        if self._last is not None:
            self._learn(x - self._last[0], excess_N - self._last[1])
        self._last = x, excess_N
        if np.linalg.norm(excess_N) <= allowed_N(scale_N):
            return True
        self.x = x + increment_for(-excess_N, self.stiffness, self.max_increment_mm)
        if len(x) == 1:
            self._bracket[bool(excess_N[0] > 0)] = float(x[0])
            self._stay_within_bracket()
        return False

    def _learn(self, increment_mm: Array, gained_N: Array) -> None:
        # Where loads fall as the body moves on, this stiffness would send it the wrong way.
        if gained_N @ increment_mm > 0:
            missed, square = gained_N - self.stiffness @ increment_mm, increment_mm @ increment_mm
            self.stiffness = self.stiffness + np.outer(missed, increment_mm) / square

    def _stay_within_bracket(self) -> None:
        if len(self._bracket) == 2:
            low, high = sorted(self._bracket.values())
            # Every second solve of a slow search halves the bracket, whatever the loads.
            if not low < self.x[0] < high or (self.is_slow and self.solves % 2 == 0):
                self.x = np.array([(low + high) / 2])

    @property
    def is_slow(self) -> bool:
        """Whether it takes more solves than usual."""
        return self.solves >= _USUAL_SOLVES

    @property
    def has_failed(self) -> bool:
        """Whether it has taken too many solves."""
        return self.solves >= (_MAX_SOLVES_OF_ONE if len(self.x) == 1 else _MAX_SOLVES)

    @property
    def jump_mm(self) -> tuple[float, float] | None:
        """Of one unknown: between which places the load passes that wanted; None if not known."""
        if len(self._bracket) < 2:
            return None
        return self._bracket[False], self._bracket[True]


def allowed_N(scale_N: float) -> float:
    """Return the allowed error of loads, the largest of which is `scale_N`."""
    return max(TOLERANCE * scale_N, _NEGLIGIBLE_N)


def increment_for(gain_N: Array, stiffness: Array, max_increment_mm: float) -> Array:
    """Return a move of the body that changes the loads by `gain_N`, (k,), unless it is too long."""
    increment_mm: Array = np.linalg.lstsq(stiffness, gain_N, rcond=1e-6)[0]
    length = float(np.linalg.norm(increment_mm))
    return increment_mm * min(1.0, max_increment_mm / length) if length else increment_mm
