"""Step control along one leg of the protocol; knows nothing of finite elements."""

from __future__ import annotations

import math
from dataclasses import dataclass, field


class StepTooSmallError(Exception):
    """The step would fall below its floor."""


@dataclass
class StepControl:
    """Adaptive positions from 0 to `length_mm`, hitting every milestone exactly.

    A failed step is halved; a step that took at most `easy_iterations` lets the next one grow,
    after a failure only when `patience` such steps have been taken.

    Parameters
    ----------
    length_mm
        Length of the leg.
    step_mm
        Length of the first step, afterwards of the next one.
    largest_mm, smallest_mm
        Bounds of the step.
    milestones_mm
        Increasing positions to be hit; the end of the leg is always one.
    """

    length_mm: float
    step_mm: float
    largest_mm: float
    smallest_mm: float
    milestones_mm: tuple[float, ...] = ()
    easy_iterations: int = 8
    growth: float = 2.0
    patience: int = 4
    position_mm: float = field(default=0.0)
    wait: int = field(default=0)

    @property
    def finished(self) -> bool:
        """Whether the end of the leg is reached."""
        return self.position_mm >= self.length_mm - 1e-9

    @property
    def at_milestone(self) -> bool:
        """Whether the present position is a milestone or the end."""
        return self.finished or bool(
            any(abs(m - self.position_mm) < 1e-9 for m in self.milestones_mm)
        )

    def target_mm(self) -> float:
        """Return the next position: at most one step on, steps to a milestone being equal."""
        ahead = [m for m in (*self.milestones_mm, self.length_mm) if m > self.position_mm + 1e-9]
        milestone = min(min(ahead), self.length_mm)
        distance = milestone - self.position_mm
        count = math.ceil(distance / min(self.step_mm, self.largest_mm) - 1e-9)
        return milestone if count <= 1 else self.position_mm + distance / count

    def accept(self, target_mm: float, iterations: int) -> None:
        """Move on to `target_mm`, reached in `iterations`."""
        taken = target_mm - self.position_mm
        self.position_mm = target_mm
        if iterations > self.easy_iterations:
            return
        if self.wait:
            self.wait -= 1
        else:
            # A step cut short by a milestone does not make the next one shorter.
            self.step_mm = min(max(self.step_mm, self.growth * taken), self.largest_mm)

    def reject(self, target_mm: float) -> None:
        """Halve the step that failed to reach `target_mm`.

        Raises
        ------
        StepTooSmallError
            If the halved step is below `smallest_mm`.
        """
        self.step_mm = (target_mm - self.position_mm) / 2
        self.wait = self.patience
        if self.step_mm < self.smallest_mm:
            raise StepTooSmallError
