"""Runs modules of Python side by side, each a process of its own, or its MPI ranks."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from typing import IO

from tactile_fem.errors import StoppedError
from tactile_fem.runtime.ranks import on_ranks, signal_handler

ERROR = "tactile-fem: "  # begins a line on stderr that says why a command failed

_POLL_S = 0.05
_SAVED = "what ran is saved up to its last steps; start it again to continue"


@dataclass(frozen=True)
class Job:
    """A module of Python that is run, with its arguments, on a number of ranks."""

    name: str
    module: str
    arguments: tuple[str, ...]
    ranks: int = 1


@dataclass(frozen=True)
class Ended:
    """How a job ended."""

    name: str
    problem: str  # why it failed, in one sentence; empty if it did not
    wall_s: float


@contextmanager
def running(waves: Iterable[Iterable[Job]], count: int) -> Iterator[Iterator[Ended]]:
    """Provide how each job ended, one after the other; a wave begins when that before has ended.

    One that fails or is killed fails alone. Those that run at the end are stopped and waited for.

    Parameters
    ----------
    waves
        The jobs.
    count
        How many run side by side at most.

    Raises
    ------
    StoppedError
        SIGTERM or SIGINT was received.
    """
    signals = list[int]()
    with signal_handler(signals.append), ExitStack() as stack:
        ended = (_run_wave(iter(wave), count, signals) for wave in waves)
        yield (one for wave in ended for one in stack.enter_context(closing(wave)))


def _run_wave(waiting: Iterator[Job], count: int, signals: Sequence[int]) -> Generator[Ended]:
    """Yield how each job of a wave ended; a job is asked for when it can start.

    Raises StoppedError if `signals` contains one; closed, it stops those that run.
    """
    running: list[_Process] = []
    try:
        while True:
            if signals:
                raise StoppedError(signals[0], _SAVED)
            while len(running) < count and (job := next(waiting, None)):
                running.append(_Process(job))
            if not running:
                return
            for process in [each for each in running if each.process.poll() is not None]:
                running.remove(process)
                yield process.end()
            time.sleep(_POLL_S)
    finally:
        for process in running:
            process.process.terminate()
        for process in running:
            process.end()


class _Process:
    """A job that runs."""

    def __init__(self, job: Job) -> None:
        self._name, self._begun = job.name, time.perf_counter()
        self._errors: IO[str] = tempfile.TemporaryFile("w+", errors="replace")
        command, environment = on_ranks(job.ranks, job.module, job.arguments)
        nothing = subprocess.DEVNULL
        self.process = subprocess.Popen(
            command, stdin=nothing, stdout=nothing, stderr=self._errors, env=environment
        )

    def end(self) -> Ended:
        """Wait for the process; return how it ended."""
        code = self.process.wait()
        with self._errors:
            self._errors.seek(0)
            lines = self._errors.read().strip().splitlines()
        problem = _last_words(lines, code) if code else ""
        return Ended(self._name, problem, time.perf_counter() - self._begun)


def _last_words(lines: Sequence[str], code: int) -> str:
    """Return what a process said when it failed: its error, else its code and its last line."""
    said = [line.removeprefix(ERROR) for line in lines if line.startswith(ERROR)]
    if said:
        return " ".join(said)
    return f"exit code {code}" + (f"; its last words: {lines[-1]}" if lines else "")
