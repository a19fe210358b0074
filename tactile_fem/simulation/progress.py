"""Shows the progress of a scan."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tactile_fem.runtime.logs import log_console, stderr_console

if TYPE_CHECKING:
    from tactile_fem.simulation.simulation import Observation

logger = logging.getLogger(__name__)

_active: list[Progress] = []


@contextmanager
def progress(
    rank: int = 0, *, console: Console | None = None, every_s: float = 15.0
) -> Iterator[Callable[[Observation], None]]:
    """Provide an observer that shows the progress of a scan.

    On a terminal that is a bar, in a notebook one line of the cell, elsewhere some lines of the
    log. Only rank 0 shows it, and not within another one. `console` is by default that of the log,
    see `tactile_fem.runtime.logs.log_console`; `every_s` is the minimum time between two lines.
    """
    if rank != 0 or _active:
        yield lambda seen: None
        return
    live = log_console() if console is None else console
    has_bar = live is not None and live.is_terminal
    in_cell = _cell_line() if live is not None and live.is_jupyter else None
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
        if in_cell is not None:
            in_cell(_Line(_with_time(line, step.fraction, bar), step.fraction))
        elif due and not has_bar:
            last_line_s, level = now, logging.INFO
            line = _with_time(line, step.fraction, bar)
        logger.log(level, "%s", line)

    _active.append(bar)
    try:
        with bar if has_bar else nullcontext():
            yield show
    finally:
        _active.remove(bar)


def _with_time(line: str, fraction: float, bar: Progress) -> str:
    """Return a line with the share that is done and an estimate of the time left."""
    left = bar.tasks[0].time_remaining
    in_words = f"{left / 60:.1f} min" if left and left >= 90 else f"{left or 0:.0f} s"
    return f"{line}  {100 * fraction:3.0f} %" + (f"  {in_words} left" if left else "")


class _Line(NamedTuple):
    """The progress of a scan, as a notebook shows it."""

    text: str
    fraction: float

    def __repr__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        bar = f'<progress max="1" value="{self.fraction:.4f}"></progress>'
        return f"{bar} <code>{escape(self.text)}</code>"


def _cell_line() -> Callable[[_Line], None]:
    """Return what shows a line in the cell that runs, in place of the line before."""
    shown = import_module("IPython.display").display(_Line("first touch", 0.0), display_id=True)
    return lambda line: shown.update(line)
