"""Output of a scan while it runs: log lines, a log file, progress on a terminal."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.logging import RichHandler
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tactile_fem.runtime.ranks import TERMINAL_VARIABLE

if TYPE_CHECKING:
    from tactile_fem.mechanics.stepper import Step
    from tactile_fem.scan import Observation

PACKAGE = "tactile_fem"
logger = logging.getLogger(__name__)
_FORMAT = "%(asctime)s %(levelname)-7s %(message)s"
_TERMINAL = f"{PACKAGE}.terminal"
_TIME = "%H:%M:%S"


def stderr_console() -> Console:
    """Return a console on stderr that knows a terminal even behind mpiexec."""
    width = os.environ.get(TERMINAL_VARIABLE, "")
    if width.isdigit() and not sys.stderr.isatty():
        return Console(stderr=True, force_terminal=True, width=int(width))
    return Console(stderr=True)


def set_up(rank: int = 0, *, level: int = logging.INFO, console: Console | None = None) -> None:
    """Send the package's log to stderr: rich on a terminal, plain lines elsewhere.

    `level` is the lowest that is shown; MPI ranks other than 0 report errors only.
    """
    console = console or stderr_console()
    handler: logging.Handler
    if console.is_terminal:
        handler = RichHandler(console=console, show_path=False, show_level=False, markup=False)
        handler.setFormatter(logging.Formatter("%(message)s", datefmt=_TIME))
    else:
        handler = logging.StreamHandler(console.file)
        handler.setFormatter(logging.Formatter(_FORMAT, datefmt=_TIME))
    handler.addFilter(lambda record: rank == 0 or record.levelno >= logging.ERROR)
    handler.setLevel(level)
    package = logging.getLogger(PACKAGE)
    handler.name = _TERMINAL
    for old in [h for h in package.handlers if h.name == _TERMINAL]:
        package.removeHandler(old)
    package.addHandler(handler)
    package.setLevel(level)
    package.propagate = False


class _LogFile(logging.FileHandler):
    """A log file without errors of its own: on a full disk the scan itself fails and reports."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Drop a record."""


@contextmanager
def log_to(path: Path, rank: int = 0) -> Iterator[None]:
    """Also write the package's log, with every step, to a file on rank 0."""
    if rank != 0:
        yield
        return
    handler = _LogFile(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter(_FORMAT))
    package = logging.getLogger(PACKAGE)
    before = package.level
    package.addHandler(handler)
    package.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        package.removeHandler(handler)
        package.setLevel(before)
        handler.close()


def describe_step(step: Step) -> str:
    """Return one line that describes a step."""
    normal = round(float(step.force_N[2]), 4) + 0.0  # no -0.0000
    tangential = (step.force_N[0] ** 2 + step.force_N[1] ** 2) ** 0.5
    return (
        f"step {step.index:3d}  {step.phase:5s} {step.displacement_mm:6.3f} mm  "
        f"depth {step.depth_mm:.3f} mm  normal {normal:.4f} N  "
        f"tangential {tangential:.4f} N  {step.newton_iterations:2d} iterations"
    )


@contextmanager
def progress(
    rank: int = 0, *, console: Console | None = None, every_s: float = 15.0
) -> Iterator[Callable[[Observation], None]]:
    """Provide an observer that shows how far a scan is: a bar on a terminal, else some lines.

    Parameters
    ----------
    rank
        MPI rank; only rank 0 shows progress.
    console
        Default stderr.
    every_s
        Minimum time between two lines if there is no terminal.
    """
    console = console or stderr_console()
    # Also without a terminal: it estimates the time left from the last minutes, because a
    # resumed scan does not begin at 0 % and the press is faster than the slide.
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        speed_estimate_period=900.0,
    )
    task = bar.add_task("first touch", total=1.0)
    last_line_s = bar.get_time()

    def show(seen: Observation) -> None:
        nonlocal last_line_s
        if rank != 0:
            return
        step = seen.step
        line, now, level = describe_step(step), bar.get_time(), logging.DEBUG
        bar.update(task, completed=step.fraction, description=line)
        due = now - last_line_s >= every_s or step.fraction >= 1.0 or step.index == 1
        if due and not console.is_terminal:
            last_line_s, level = now, logging.INFO
            line += f"  {100 * step.fraction:3.0f} %{_time_left(bar)}"
        logger.log(level, "%s", line)

    with bar if console.is_terminal and rank == 0 else nullcontext():
        yield show


def _time_left(bar: Progress) -> str:
    left = bar.tasks[0].time_remaining
    if not left:
        return ""
    return f"  {left / 60:.1f} min left" if left >= 90 else f"  {left:.0f} s left"
