"""Control of the steps along one piece of the path; knows nothing of finite elements."""

from __future__ import annotations

import math
from dataclasses import dataclass


class StepTooSmallError(Exception):
    """The step would fall below its floor."""


# Times that differ by less than this share of the piece's are the same.
_ROUNDING = 1e-9


@dataclass
class StepControl:
    """Adaptive times from 0 to the end of a piece, meeting every output exactly.

    A failed step is halved; a step that took at most `easy_iterations` lets the next one grow,
    after a failure only when `patience` such steps have been taken.

    Parameters
    ----------
    end_s
        Where the piece ends.
    step_s
        First step, afterwards the next one.
    smallest_s
        A step below this is refused.
    outputs_s
        Increasing times to be met; the end is always one.

    Attributes
    ----------
    time_s
        How far the piece is gone.
    wait
        How many easy steps have to be taken until the step may grow again.
    """

    end_s: float
    step_s: float
    smallest_s: float
    outputs_s: tuple[float, ...] = ()
    easy_iterations: int = 8
    growth: float = 2.0
    patience: int = 4
    time_s: float = 0.0
    wait: int = 0

    @property
    def finished(self) -> bool:
        """Whether the end is reached."""
        return self.time_s >= self.end_s - self._rounding

    @property
    def at_output(self) -> bool:
        """Whether the present time is an output or the end."""
        return self.finished or any(abs(t - self.time_s) < self._rounding for t in self.outputs_s)

    @property
    def _rounding(self) -> float:
        return _ROUNDING * self.end_s

    def target_s(self, most_s: float = math.inf) -> float:
        """Return the next time, steps to an output being equal.

        Parameters
        ----------
        most_s
            A further bound of the step, for where the piece is now.
        """
        ahead = [t for t in (*self.outputs_s, self.end_s) if t > self.time_s + self._rounding]
        output = float(min(min(ahead), self.end_s))
        time = output - self.time_s
        count = math.ceil(time / min(self.step_s, most_s) - _ROUNDING)
        return output if count <= 1 else self.time_s + time / count

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
        """Halve the step that failed to reach `target_s`.

        Raises
        ------
        StepTooSmallError
            If the halved step is below `smallest_s`.
        """
        self.step_s = (target_s - self.time_s) / 2
        self.wait = self.patience
        if self.step_s < self.smallest_s:
            raise StepTooSmallError
