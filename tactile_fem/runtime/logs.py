"""Log lines on a terminal and in a file."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.logging import RichHandler

from tactile_fem.runtime.ranks import TERMINAL_VARIABLE

PACKAGE = "tactile_fem"
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


@contextmanager
def each_once(*modules: str) -> Iterator[None]:
    """Log what the modules, named without the package, say only once if they repeat it."""
    said: set[str] = set()

    def is_new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        before = text in said
        said.add(text)
        return not before

    loggers = [logging.getLogger(f"{PACKAGE}.{module}") for module in modules]
    for one in loggers:
        one.addFilter(is_new)
    try:
        yield
    finally:
        for one in loggers:
            one.removeFilter(is_new)


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
