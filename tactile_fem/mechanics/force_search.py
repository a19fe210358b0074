"""The search for the height of the body at which a normal force is met; no finite elements."""

from __future__ import annotations

import math
from dataclasses import dataclass

TOLERANCE = 1e-3
# Solves in which a force has to be met; after the first ones each halves the bracket.
_MOST_SOLVES, _SECANT_SOLVES = 12, 4


@dataclass
class ForceSearch:
    """The secant method, safeguarded by bisection.

    Parameters
    ----------
    force_N
        The normal force that is sought.
    z_mm
        Height of the body at the first solve, then at the next one.
    stiffness_N_mm
        Normal force over depth, as far as it is known.
    most_mm
        Longest way between two solves.
    least_mm
        Width of a bracket within which the force is taken to jump.

    Attributes
    ----------
    below_mm, above_mm
        The bracket: heights with less and with more than the force.
    solves
        Their number so far.
    """

    force_N: float
    z_mm: float
    stiffness_N_mm: float
    most_mm: float
    least_mm: float
    below_mm: float = -math.inf
    above_mm: float = math.inf
    solves: int = 0
    _last: tuple[float, float] | None = None

    def is_met(self, force_N: float) -> bool:
        """Return whether the force at `z_mm` is the wanted one; if it is not, move `z_mm`."""
        z, self.solves = self.z_mm, self.solves + 1
        if self._last and (force_N - self._last[1]) * (z - self._last[0]) > 0:
            self.stiffness_N_mm = (force_N - self._last[1]) / (z - self._last[0])
        if abs(force_N - self.force_N) <= TOLERANCE * self.force_N:
            return True
        self._last = z, force_N
        if force_N < self.force_N:
            self.below_mm = z
        else:
            self.above_mm = z
        way = (self.force_N - force_N) / self.stiffness_N_mm
        self.z_mm = z + min(max(way, -self.most_mm), self.most_mm)
        inside = self.below_mm < self.z_mm < self.above_mm
        if math.isfinite(self.above_mm - self.below_mm) and (self.is_slow or not inside):
            self.z_mm = (self.below_mm + self.above_mm) / 2
        return False

    @property
    def is_slow(self) -> bool:
        """Whether it takes more solves than usual."""
        return self.solves >= _SECANT_SOLVES

    @property
    def has_failed(self) -> bool:
        """Whether further solves are in vain."""
        return self.solves >= _MOST_SOLVES or self.above_mm - self.below_mm < self.least_mm

    @property
    def reason(self) -> str:
        """Why the force is not met, in words."""
        below, above = self.below_mm, self.above_mm
        if math.isfinite(above - below):
            return (
                f"the force is not met: it jumps between depths of {below:.5f} and {above:.5f} mm"
            )
        side, depth_mm = ("less", below) if math.isfinite(below) else ("more", above)
        return f"the force is not met: it is still {side} at a depth of {depth_mm:.5f} mm"
