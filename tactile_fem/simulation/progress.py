"""Shows how far a scan is."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tactile_fem.runtime.logs import live_console, stderr_console

if TYPE_CHECKING:
    from tactile_fem.simulation.simulation import Observation

logger = logging.getLogger(__name__)

_active: list[Progress] = []


@contextmanager
def progress(
    rank: int = 0, *, console: Console | None = None, every_s: float = 15.0
) -> Iterator[Callable[[Observation], None]]:
    """Provide an observer that shows how far a scan is: a bar, or else some lines of the log.

    Only rank 0 shows it, and not within another one. `console` is by default that of the log, see
    `tactile_fem.runtime.logs.live_console`; `every_s` is the minimum time between two lines.
    """
    if rank != 0 or _active:
        yield lambda seen: None
        return
    live = live_console() if console is None else console
    has_bar = live is not None and (live.is_terminal or live.is_jupyter)
    # Also without a bar on the screen: it estimates the time left from the last minutes, because a
    # resumed scan does not begin at 0 % and the press is faster than the slide.
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=live or stderr_console(),
        speed_estimate_period=900.0,
    )
    task = bar.add_task("first touch", total=1.0)
    last_line_s = bar.get_time()

    def show(seen: Observation) -> None:
        nonlocal last_line_s
        step = seen.step
        line, now, level = str(step), bar.get_time(), logging.DEBUG
        bar.update(task, completed=step.fraction, description=line)
        due = now - last_line_s >= every_s or step.fraction >= 1.0 or step.index == 1
        if due and not has_bar:
            last_line_s, level = now, logging.INFO
            line += f"  {100 * step.fraction:3.0f} %{_time_left(bar)}"
        logger.log(level, "%s", line)

    _active.append(bar)
    try:
        with bar if has_bar else nullcontext():
            yield show
            if has_bar:
                bar.refresh()  # in a notebook the end is not drawn otherwise
    finally:
        _active.remove(bar)


def _time_left(bar: Progress) -> str:
    left = bar.tasks[0].time_remaining
    if not left:
        return ""
    return f"  {left / 60:.1f} min left" if left >= 90 else f"  {left:.0f} s left"
