"""The search for the height of the body at which a normal force is met; no finite elements."""

from __future__ import annotations

from dataclasses import dataclass

TOLERANCE = 1e-3
# Solves in which a force has to be met, and how many are usual.
_MOST_SOLVES, _USUAL_SOLVES = 12, 4
# Once there is a bracket every so many solves halve it, whatever the force.
_HALVING = 3


@dataclass
class ForceSearch:
    """The secant method, then regula falsi (Illinois) safeguarded by bisection.

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

    Attributes
    ----------
    solves
        Their number so far.
    """

    force_N: float
    z_mm: float
    stiffness_N_mm: float
    most_mm: float
    solves: int = 0
    _last: tuple[float, float] | None = None
    # Heights with less and with more than the force, and the force there less that which is sought.
    _below: tuple[float, float] | None = None
    _above: tuple[float, float] | None = None

    def is_met(self, force_N: float) -> bool:
        """Return whether the force at `z_mm` is the wanted one; if it is not, move `z_mm`."""
        z, excess, self.solves = self.z_mm, force_N - self.force_N, self.solves + 1
        if self._last and (excess - self._last[1]) * (z - self._last[0]) > 0:
            self.stiffness_N_mm = (excess - self._last[1]) / (z - self._last[0])
        if abs(excess) <= TOLERANCE * self.force_N:
            return True
        again = self._last is not None and self._last[1] * excess > 0
        if excess < 0:
            self._below, self._above = (z, excess), _halved(self._above, again)
        else:
            self._below, self._above = _halved(self._below, again), (z, excess)
        self._last = z, excess
        self.z_mm = self._next(z, excess)
        return False

    def _next(self, z: float, excess: float) -> float:
        if self._below is None or self._above is None:
            way = -excess / self.stiffness_N_mm
            return z + min(max(way, -self.most_mm), self.most_mm)
        (low, less), (high, more) = self._below, self._above
        if self.solves % _HALVING == 0:
            return (low + high) / 2
        return (low * more - high * less) / (more - less)

    @property
    def is_slow(self) -> bool:
        """Whether it takes more solves than usual."""
        return self.solves >= _USUAL_SOLVES

    @property
    def has_failed(self) -> bool:
        """Whether it has taken too many solves."""
        return self.solves >= _MOST_SOLVES

    @property
    def reason(self) -> str:
        """Why the force is not met, in words."""
        if self._below and self._above:
            at, width = self._below[0], abs(self._above[0] - self._below[0])
            return f"the force is not met: it jumps within {width:.1g} mm at a depth of {at:.4f} mm"
        side, end = ("less", self._below) if self._below else ("more", self._above)
        depth_mm = end[0] if end else self.z_mm
        return f"the force is not met: it is still {side} at a depth of {depth_mm:.5f} mm"


def _halved(end: tuple[float, float] | None, again: bool) -> tuple[float, float] | None:
    """Return the end of a bracket that is kept, with half of its excess if it is so `again`."""
    return (end[0], end[1] / 2) if end and again else end
