"""Control of the steps along a piece of the path, and of the height at which a force is met.

Plain numbers: it knows nothing of finite elements.
"""

from __future__ import annotations

import math
from bisect import bisect
from dataclasses import dataclass

# Times that differ by less than this share of the piece's are the same.
_ROUNDING = 1e-9
# Share of a normal force by which it may be missed.
TOLERANCE = 1e-3
# Solves in which a force has to be met, and how many are usual.
_MOST_SOLVES, _USUAL_SOLVES = 12, 4
# Once there is a bracket, every so many solves halve it, whatever the force.
_BISECTION_PERIOD = 3


class StepTooSmallError(Exception):
    """The step would fall below its floor."""


@dataclass
class StepControl:
    """Adaptive times from 0 to the end of a piece, meeting every output exactly.

    A failed step is halved; a step that took at most `easy_iterations` lets the next one grow,
    after a failure only when `patience` such steps have been taken.
    """

    end_s: float  # of the piece
    step_s: float  # first step, afterwards the next one
    smallest_s: float  # a step below this is refused
    outputs_s: tuple[float, ...] = ()  # increasing; the end is always one
    easy_iterations: int = 8
    growth: float = 2.0
    patience: int = 4
    time_s: float = 0.0  # how far the piece is gone
    wait: int = 0  # how many easy steps have to be taken until the step may grow again

    @property
    def finished(self) -> bool:
        """Whether the end is reached."""
        return self.time_s >= self.end_s - self._rounding

    @property
    def at_output(self) -> bool:
        """Whether the present time is an output or the end; without outputs every time is one."""
        if self.finished or not self.outputs_s:
            return True
        return abs(self._next_output_s(self.time_s - self._rounding) - self.time_s) < self._rounding

    @property
    def _rounding(self) -> float:
        return _ROUNDING * self.end_s

    def target_s(self, most_s: float = math.inf) -> float:
        """Return the next time, at most `most_s` ahead; steps to an output are equal."""
        output = self._next_output_s(self.time_s + self._rounding)
        time = output - self.time_s
        count = math.ceil(time / min(self.step_s, most_s) - _ROUNDING)
        return output if count <= 1 else self.time_s + time / count

    def _next_output_s(self, after_s: float) -> float:
        """Return the first output after a time, or the end."""
        number = bisect(self.outputs_s, after_s)
        return float(min((*self.outputs_s[number : number + 1], self.end_s)))

    def accept(self, target_s: float, iterations: int) -> None:
        """Move on to `target_s`, reached in `iterations`."""
        taken = target_s - self.time_s
        self.time_s = target_s
        if iterations > self.easy_iterations:
            return
        if self.wait:
            self.wait -= 1
        else:
            # A step cut short by an output does not make the next one shorter.
            self.step_s = max(self.step_s, self.growth * taken)

    def reject(self, target_s: float) -> None:
        """Halve the step that failed to reach `target_s`; StepTooSmallError if it is too small."""
        self.step_s = (target_s - self.time_s) / 2
        self.wait = self.patience
        if self.step_s < self.smallest_s:
            raise StepTooSmallError


@dataclass
class ForceSearch:
    """The height of the body at which a normal force is met.

    The secant method, then regula falsi (Illinois) safeguarded by bisection.
    """

    force_N: float  # that is sought
    z_mm: float  # height of the body at the first solve, then at the next one
    stiffness_N_mm: float  # normal force over depth, as far as it is known
    most_mm: float  # longest way between two solves
    solves: int = 0  # their number so far
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
        if self.solves % _BISECTION_PERIOD == 0:
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
