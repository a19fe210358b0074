"""Shows how far a scan has come."""

from __future__ import annotations

import logging
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tactile_fem.runtime.logs import stderr_console

if TYPE_CHECKING:
    from tactile_fem.mechanics.stepper import Step
    from tactile_fem.scan.run import Observation

logger = logging.getLogger(__name__)


def describe_step(step: Step) -> str:
    """Return one line that describes a step."""
    normal = round(float(step.force_N[2]), 4) + 0.0  # no -0.0000
    tangential = (step.force_N[0] ** 2 + step.force_N[1] ** 2) ** 0.5
    return (
        f"step {step.index:3d}  {step.phase:5s} {step.displacement_mm:6.3f} mm  "
        f"depth {step.depth_mm:.3f} mm  normal {normal:.4f} N  "
        f"tangential {tangential:.4f} N  {step.newton_iterations:2d} iterations"
    )


class ProgressDisplay:
    """Shows the progress of a scan: a bar on a terminal, occasional lines elsewhere.

    A context manager: a bar left open would garble the terminal.

    Parameters
    ----------
    rank
        MPI rank; only rank 0 shows progress.
    console
        Default stderr.
    every_s
        Minimum time between two lines if there is no terminal.
    """

    def __init__(
        self, rank: int = 0, *, console: Console | None = None, every_s: float = 15.0
    ) -> None:
        console = console or stderr_console()
        self._silent = rank != 0
        self._every = every_s
        # Also without a terminal: it estimates the time left from the last minutes, because a
        # resumed scan does not begin at 0 % and the press is faster than the slide.
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.percentage:3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            speed_estimate_period=900.0,
        )
        self._shown = console.is_terminal and not self._silent
        self._task = self._bar.add_task("first touch", total=1.0)
        self._last_line_s = self._bar.get_time()

    def __enter__(self) -> Self:
        """Open the display."""
        if self._shown:
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it, also after an error."""
        if self._shown:
            self._bar.stop()

    def step(self, seen: Observation) -> None:
        """Show an accepted step; an observer of a scan."""
        if self._silent:
            return
        step = seen.step
        line, now, level = describe_step(step), self._bar.get_time(), logging.DEBUG
        self._bar.update(self._task, completed=step.fraction, description=line)
        due = now - self._last_line_s >= self._every or step.fraction >= 1.0 or step.index == 1
        if due and not self._shown:
            self._last_line_s, level = now, logging.INFO
            line += f"  {100 * step.fraction:3.0f} %{self._time_left()}"
        logger.log(level, "%s", line)

    def _time_left(self) -> str:
        left = self._bar.tasks[self._task].time_remaining
        if not left:
            return ""
        return f"  {left / 60:.1f} min left" if left >= 90 else f"  {left:.0f} s left"
