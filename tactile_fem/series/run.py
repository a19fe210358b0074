"""Runs a series: each scan in a process of its own, some at a time, finished ones not again."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

from tactile_fem.errors import StoppedError, StudyError
from tactile_fem.runtime.files import write_text
from tactile_fem.runtime.signals import answering
from tactile_fem.scan.checks import check_study
from tactile_fem.scan.results import Results
from tactile_fem.series.members import Member
from tactile_fem.study.file import dump_study, load_study

logger = logging.getLogger(__name__)

# How often signals are looked for: an error raised by the handler itself, in the middle of
# anything, might leave a lock taken or a scan not asked to end.
_GLANCE_S = 0.3


@dataclass(frozen=True)
class Task:
    """A share of a series, for schedulers: number `number` of `count`, from 1 on."""

    number: int = 1
    count: int = 1

    @classmethod
    def parse(cls, text: str) -> Task:
        """Return the task that ``K/N`` names.

        Raises
        ------
        StudyError
            It is not that, or K is not from 1 to N.
        """
        first, _, last = text.partition("/")
        if not (first.isdecimal() and last.isdecimal() and 1 <= int(first) <= int(last)):
            raise StudyError(f'--task is "{text}" but must be K/N with K from 1 to N.')
        return cls(int(first), int(last))

    def of(self, members: Sequence[Member]) -> list[Member]:
        """Return the members of this share."""
        return list(members[self.number - 1 :: self.count])


@dataclass(frozen=True)
class Outcome:
    """How a scan of a series ended.

    Attributes
    ----------
    problem
        Why it failed, in a sentence; empty if it is complete.
    wall_s
        What it took this time; 0 if it was complete before.
    """

    member: Member
    problem: str
    wall_s: float


def folder_of(member: Member, folder: Path) -> Path:
    """Return the results folder of a member."""
    return folder / member.name


def run_series(
    members: Sequence[Member],
    folder: Path | str,
    *,
    jobs: int = 1,
    ranks: int = 1,
    task: Task | None = None,
) -> list[Outcome]:
    """Run the scans that are not complete; one that fails does not stop the others.

    Started again, it goes on where it was cut off. Several tasks may share a folder.

    Parameters
    ----------
    members
        All scans of the series.
    folder
        Holds a study file and a results folder for each of them.
    jobs, ranks
        Scans at a time, and MPI processes for each.
    task
        The share to run; default all.

    Raises
    ------
    StudyError
        Bad input, before anything runs; or the folder holds another series.
    StoppedError
        SIGTERM or SIGINT came.
    """
    folder = Path(folder)
    mine = (task or Task()).of(members)
    for member in mine:
        check_study(member.study)
        _keep_study(member, folder)
    complete = {member.name for member in mine if is_complete(member, folder)}
    left = [member for member in mine if member.name not in complete]
    outcomes = [Outcome(member, "", 0.0) for member in mine if member.name in complete]
    logger.info("%d scans, %d of them complete", len(mine), len(complete))
    begun = time.perf_counter()
    runner = _Runner(folder, ranks)
    asked: list[int] = []
    with answering(asked.append), ThreadPoolExecutor(jobs) as pool:
        running = {pool.submit(runner.run, member) for member in left}
        try:
            for done, outcome in enumerate(_as_they_end(running, asked), start=1):
                outcomes.append(outcome)
                minutes = (time.perf_counter() - begun) / done * (len(left) - done) / 60
                _tell(outcome, f"{done} of {len(left)}, about {minutes:.0f} min left")
        except BaseException:
            runner.stop()
            pool.shutdown(cancel_futures=True)
            raise
    order = {member.name: k for k, member in enumerate(mine)}
    return sorted(outcomes, key=lambda outcome: order[outcome.member.name])


def _as_they_end(running: set[Future[Outcome]], asked: list[int]) -> Iterator[Outcome]:
    """Yield how scans end, one after the other, until a signal is found among those that came."""
    while running:
        ended, running = wait(running, _GLANCE_S, FIRST_COMPLETED)
        yield from (future.result() for future in ended)
        if asked:
            raise StoppedError(asked[0])


def is_complete(member: Member, folder: Path) -> bool:
    """Tell whether a member's scan has come to its end."""
    return Results(folder_of(member, folder)).complete


def complete_scans(members: Sequence[Member], folder: Path) -> list[Results]:
    """Return the results of the members that are complete, in their order."""
    return [
        Results.open(folder_of(member, folder)) for member in members if is_complete(member, folder)
    ]


class _Runner:
    """Starts scans as processes and can end all that run."""

    def __init__(self, folder: Path, ranks: int) -> None:
        self._folder = folder
        self._ranks = ranks
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(self, member: Member) -> Outcome:
        """Run a member's scan to its end."""
        begun = time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "tactile_fem",
            "scan",
            str(_study_file(member, self._folder)),
        ]
        command += ["--results", str(folder_of(member, self._folder)), "--ranks", str(self._ranks)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        with self._lock:
            if self._stopped:
                return Outcome(member, "not begun", 0.0)
            process = subprocess.Popen(
                command,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                env=environment,
            )
            self._running.add(process)
        _, said = process.communicate()
        with self._lock:
            self._running.discard(process)
        lines = said.strip().splitlines() or [f"exit code {process.returncode}"]
        problem = lines[-1] if process.returncode else ""
        return Outcome(member, problem, time.perf_counter() - begun)

    def stop(self) -> None:
        """Ask all scans that run to save and end."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.terminate()


def _study_file(member: Member, folder: Path) -> Path:
    return folder / f"{member.name}.toml"


def _keep_study(member: Member, folder: Path) -> None:
    """Write a member's study, or see that the one there is the same."""
    path = _study_file(member, folder)
    try:
        if path.is_file():
            if load_study(path) != member.study:
                raise StudyError(f"{path} is the study of another series: choose another folder.")
            return
        folder.mkdir(parents=True, exist_ok=True)
        write_text(path, dump_study(member.study))
    except OSError as error:
        raise StudyError(f"The folder {folder} cannot be used: {error.strerror}.") from None


def _tell(outcome: Outcome, progress: str) -> None:
    if outcome.problem:
        logger.warning("%s failed (%s): %s", outcome.member.name, progress, outcome.problem)
    else:
        logger.info("%s: %.0f s (%s)", outcome.member.name, outcome.wall_s, progress)
