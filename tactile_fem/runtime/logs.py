"""Log lines and progress on a terminal, in a notebook and in a file."""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.logging import RichHandler
from rich.progress import track

from tactile_fem.runtime.ranks import TERMINAL_VARIABLE, is_first

logger = logging.getLogger(__name__)

PACKAGE = "tactile_fem"
_FORMAT = "%(asctime)s %(levelname)-7s %(message)s"
_TIME = "%H:%M:%S"
# The handlers that `set_up` has added: one or none.
_consoles: dict[logging.Handler, Console] = {}


def stderr_console() -> Console:
    """Return a console on stderr that detects a terminal even behind mpiexec."""
    width = os.environ.get(TERMINAL_VARIABLE, "")
    if width.isdigit() and not sys.stderr.isatty():
        return Console(stderr=True, force_terminal=True, width=int(width))
    return Console(stderr=True)


def set_up(*, level: int = logging.INFO, console: Console | None = None) -> None:
    """Send the log of the package to stderr: rich on a terminal, plain lines elsewhere.

    `level` is the lowest that is shown; MPI ranks other than the first report errors only.
    """
    console = console or stderr_console()
    handler: logging.Handler
    if console.is_terminal:
        handler = RichHandler(console=console, show_path=False, show_level=False, markup=False)
        handler.setFormatter(logging.Formatter("%(message)s", datefmt=_TIME))
    else:
        handler = logging.StreamHandler(console.file)
        handler.setFormatter(logging.Formatter(_FORMAT, datefmt=_TIME))
    handler.addFilter(lambda record: record.levelno >= logging.ERROR or is_first())
    handler.setLevel(level)
    package = logging.getLogger(PACKAGE)
    _remove_terminal()
    _consoles[handler] = console
    package.addHandler(handler)
    package.setLevel(level)
    package.propagate = False


@contextmanager
def each_once(*modules: str) -> Iterator[None]:
    """Log a message that the modules, named without the package, repeat only once."""
    logged: set[str] = set()

    def is_new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        repeated = text in logged
        logged.add(text)
        return not repeated

    loggers = [logging.getLogger(f"{PACKAGE}.{module}") for module in modules]
    for one in loggers:
        one.addFilter(is_new)
    try:
        yield
    finally:
        for one in loggers:
            one.removeFilter(is_new)


def _remove_terminal() -> None:
    for handler in list(_consoles):
        logging.getLogger(PACKAGE).removeHandler(handler)
        del _consoles[handler]


@contextmanager
def shown() -> Iterator[None]:
    """Show the log of the package on stderr for a while, unless logging is configured.

    It is configured if the root logger or that of ``tactile_fem`` has a handler, even a
    `logging.NullHandler`, which therefore keeps the package quiet. Also a decorator.
    """
    package = logging.getLogger(PACKAGE)
    if package.hasHandlers():
        yield
        return
    before = package.level, package.propagate
    set_up()
    try:
        yield
    finally:
        _remove_terminal()
        package.setLevel(before[0])
        package.propagate = before[1]


def log_console() -> Console | None:
    """Return the console that shows the log with its INFO, if the package has set one up."""
    for handler in logging.getLogger(PACKAGE).handlers:
        if handler in _consoles and handler.level <= logging.INFO:
            return _consoles[handler]
    return None


def counted[T](items: Sequence[T], what: str, *, every_s: float = 15.0) -> Iterator[T]:
    """Yield items and show how many are done: a bar, or else a log line now and then."""
    if len(items) > 1:
        logger.info("%d %s", len(items), what)
    console = log_console()
    if console is not None and console.is_terminal and len(items) > 1:
        yield from track(items, what, console=console, transient=True)
        return
    start = logged = time.perf_counter()
    for number, item in enumerate(items):
        now = time.perf_counter()
        if number and now - logged >= every_s:
            logged, left_s = now, (now - start) / number * (len(items) - number)
            logger.info("%d of %d %s, %.0f s left", number, len(items), what, left_s)
        yield item


class _LogFile(logging.FileHandler):
    """A log file without errors of its own: on a full disk the scan itself fails and reports."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Drop a record."""


@contextmanager
def log_to(path: Path, rank: int = 0) -> Iterator[None]:
    """Also write the log of the package, with every step, to a file on rank 0.

    Other handlers get what they got before.
    """
    if rank != 0:
        yield
        return
    package = logging.getLogger(PACKAGE)
    before, level, others = package.level, package.getEffectiveLevel(), _handlers(package)

    def was_shown(record: logging.LogRecord) -> bool:
        return record.levelno >= level or not record.name.startswith(PACKAGE)

    handler = _LogFile(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter(_FORMAT))
    for other in others:
        other.addFilter(was_shown)
    package.addHandler(handler)
    package.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        package.removeHandler(handler)
        package.setLevel(before)
        for other in others:
            other.removeFilter(was_shown)
        handler.close()


def _handlers(logger: logging.Logger | None) -> list[logging.Handler]:
    """Return the handlers of a logger and of those that it propagates to."""
    found: list[logging.Handler] = []
    while logger is not None:
        found += logger.handlers
        logger = logger.parent if logger.propagate else None
    return found
