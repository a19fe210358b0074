"""The times at which the steps along a piece of the path end.

Plain numbers: it knows nothing of finite elements, nor of forces.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Callable
from dataclasses import dataclass

# Times that differ by less than this share of the piece's are the same.
_ROUNDING = 1e-9


@dataclass
class StepControl:
    """Adaptive times from 0 to the end of a piece, meeting every output exactly.

    A failed step is cut back; a step that took at most `target_iterations` lets the next one grow,
    after a failure only when `patience` such steps have been taken.
    """

    end_s: float  # of the piece
    step_s: float  # first step; then the next one, unless an output or `max_step_s` shortens it
    min_step_s: float  # a failed step is not cut back further
    max_step_s: Callable[[float], float] = lambda time_s: math.inf  # longest one from a time on
    outputs_s: tuple[float, ...] = ()  # increasing; the end is always one
    target_iterations: int = 8
    growth_factor: float = 2.0
    cutback_factor: float = 0.5
    patience: int = 4
    time_s: float = 0.0  # time reached
    wait: int = 0  # easy steps still to be taken before a step may grow again

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

    @property
    def target_s(self) -> float:
        """The next time; steps to an output are equal."""
        output = self._next_output_s(self.time_s + self._rounding)
        time = output - self.time_s
        longest = min(self.step_s, self.max_step_s(self.time_s))
        count = math.ceil(time / longest - _ROUNDING)
        return output if count <= 1 else self.time_s + time / count

    def _next_output_s(self, after_s: float) -> float:
        """Return the first output after a time, or the end."""
        number = bisect(self.outputs_s, after_s)
        return float(min((*self.outputs_s[number : number + 1], self.end_s)))

    def accept(self, target_s: float, iterations: int) -> None:
        """Move on to `target_s`, reached in `iterations`."""
        taken = target_s - self.time_s
        self.time_s = target_s
        if iterations > self.target_iterations:
            return
        if self.wait:
            self.wait -= 1
        else:
            # A step cut short by an output does not make the next one shorter.
            self.step_s = max(self.step_s, self.growth_factor * taken)

    def reject(self, target_s: float) -> bool:
        """Cut back the step that failed to reach `target_s`; return whether it is long enough."""
        self.step_s = self.cutback_factor * (target_s - self.time_s)
        self.wait = self.patience
        return self.step_s >= self.min_step_s

    def finish(self) -> None:
        """End the piece at the present time."""
        self.end_s = self.time_s

    def to_save(self) -> dict[str, float]:
        """Return by name what changes along the piece."""
        names = "end_s", "step_s", "time_s", "wait"
        return {name: getattr(self, name) for name in names}
