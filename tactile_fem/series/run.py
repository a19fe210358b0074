"""Runs the scans of a series that are not complete, side by side; tabulates it."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tactile_fem.errors import StudyError, TactileError, raise_all
from tactile_fem.results.numbers import numbers_of
from tactile_fem.results.results import Results
from tactile_fem.runtime.files import write_table, write_text
from tactile_fem.runtime.jobs import Job, running
from tactile_fem.runtime.logs import shown
from tactile_fem.series.members import Member
from tactile_fem.series.sharing import begin_with, of_same_mechanics
from tactile_fem.simulation.checks import check
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.input_copies import keep_files

logger = logging.getLogger(__name__)

_NOT_RUN = "it has not run"

_Shared = tuple[Member, list[str]]  # a member, and the names of those with its mechanics


@dataclass(frozen=True)
class Outcome:
    """How a scan of a series ended."""

    member: Member
    problem: str  # why it failed, in one sentence; empty if it is complete
    wall_s: float  # of this run; 0 if it was complete before


@shown()
def run_series(
    members: Sequence[Member], folder: Path | str, *, jobs: int = 1, ranks: int = 1
) -> list[Outcome]:
    """Run the scans that are not complete; one that fails does not stop the others.

    Each is a process of its own, ``tactile-fem scan``, and its numbers depend on its study alone.
    If interrupted and called again, the series continues. The folder holds a study file and a
    results folder for each scan, and ``….failed.txt`` if it failed. Scans that differ only in what
    follows the mechanics share it.

    Parameters
    ----------
    jobs, ranks
        Number of scans in parallel, and of MPI processes for each.

    Raises
    ------
    StudyError
        Bad input, before anything runs; or the folder contains another series.
    StoppedError
        SIGTERM or SIGINT was received; the running scans have been asked to stop.
    """
    folder = Path(folder)
    begin_series(members, folder)
    left = [member for member in members if not Results(folder / member.name).complete]
    outcomes = {member.name: Outcome(member, "", 0.0) for member in members}
    for outcome in outcomes.values():
        keep_reason(outcome, folder)
    logger.info("%d scans, %d of them complete", len(members), len(members) - len(left))
    begun = time.perf_counter()
    waves = ([_job(*each, folder, ranks) for each in wave] for wave in _waves(members, left))
    with running(waves, jobs) as scans:
        for done, ended in enumerate(scans, 1):
            member = outcomes[ended.name].member
            outcome = outcomes[ended.name] = Outcome(member, ended.problem, ended.wall_s)
            keep_reason(outcome, folder)
            minutes = (time.perf_counter() - begun) / done * (len(left) - done) / 60
            _log(outcome, f"{done} of {len(left)}, about {minutes:.0f} min left")
    return list(outcomes.values())


def begin_series(members: Sequence[Member], folder: Path) -> None:
    """Write the study files of a series, or check that those which are there are the same.

    Raises what `run_series` does.
    """
    raise_all(*(partial(check, member.study) for member in members))
    for member in members:
        _save_study(member, folder)


def _waves(members: Sequence[Member], left: Sequence[Member]) -> Iterator[list[_Shared]]:
    """Yield members to scan: one of each mechanics that nobody has, then those that share it."""
    wanted = {member.name for member in left}
    first, others = list[_Shared](), list[_Shared]()
    for group in of_same_mechanics(members):
        names = [member.name for member in group]
        missing = [(member, names) for member in group if member.name in wanted]
        leading = 1 if len(missing) == len(group) else 0
        first += missing[:leading]
        others += missing[leading:]
    yield first
    yield others


def _job(member: Member, same: Sequence[str], folder: Path, ranks: int) -> Job:
    """Return the job of a scan, begun with the mechanics of one named in `same`, if complete."""
    own = folder / member.name
    scans = (Results(folder / name) for name in same)
    if not own.exists() and (source := next((s for s in scans if s.complete), None)):
        begin_with(source.folder, own, member.study)
    words = "scan", str(own.with_name(f"{member.name}.toml")), "--results", str(own)
    return Job(member.name, "tactile_fem", words, ranks)


def run_all(
    members: Sequence[Member], folder: Path, *, jobs: int = 1, ranks: int = 1
) -> list[Results]:
    """Run a series of which every scan is needed; return the results in the members' order.

    Raises
    ------
    TactileError
        A scan failed; or see `run_series`.
    """
    for outcome in run_series(members, folder, jobs=jobs, ranks=ranks):
        if outcome.problem:
            raise TactileError(outcome.problem)
    return complete_scans(members, folder)


def collected(members: Sequence[Member], folder: Path | str) -> list[Outcome]:
    """Return the outcomes of scans of a series that ran elsewhere."""
    outcomes = []
    for member in members:
        scan = Path(folder) / member.name
        problem = "" if Results(scan).complete else reason_of(scan) or _NOT_RUN
        outcomes.append(Outcome(member, problem, 0.0))
    return outcomes


def complete_scans(members: Sequence[Member], folder: Path) -> list[Results]:
    """Return the results of the complete members, in the order of the members."""
    scans = [Results(folder / member.name) for member in members]
    return [scan for scan in scans if scan.complete]


def keep_reason(outcome: Outcome, folder: Path) -> None:
    """Write beside its folder why a scan failed; remove what an earlier run wrote there."""
    file = folder / f"{outcome.member.name}.failed.txt"
    if outcome.problem:
        write_text(file, outcome.problem + "\n")
    else:
        file.unlink(missing_ok=True)


def reason_of(scan: Path) -> str:
    """Return why the scan of a folder failed, in one sentence; empty if it did not."""
    file = scan.with_name(f"{scan.name}.failed.txt")
    return file.read_text(encoding="utf-8").strip() if file.is_file() else ""


def write_summary(members: Sequence[Member], folder: Path | str) -> Path:
    """Write ``summary.csv``: values, status and numbers of each scan; return its path."""
    folder = Path(folder)
    rows = [
        {"scan": member.name, **member.values, **_numbers(Results(folder / member.name))}
        for member in members
    ]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    path = folder / "summary.csv"
    write_table(path, [{name: row.get(name, "") for name in columns} for row in rows])
    return path


def _numbers(results: Results) -> dict[str, Any]:
    """Return the numbers of a scan; only its status, and why, if it is not complete."""
    if not results.complete:
        why = reason_of(results.folder)
        return {"status": "not complete", **({"failed": why} if why else {})}
    numbers = numbers_of(results)
    short = {k: float(f"{v:.5g}") if isinstance(v, float) else v for k, v in numbers.items()}
    return {"status": "complete", **short, "wall_s": round(numbers["wall_s"], 1)}


def _save_study(member: Member, folder: Path) -> None:
    """Write a member's study file and keep what it names, or check that it is the same."""
    path = folder / f"{member.name}.toml"
    try:
        if path.is_file():
            if load_study(path) != member.study:
                raise StudyError(
                    f"{path} belongs to another series, or a file that it names has changed: "
                    "choose another folder."
                )
            return
        folder.mkdir(parents=True, exist_ok=True)
        write_text(path, dump_study(member.study))
        keep_files(member.study, folder, afresh=False)
    except OSError as error:
        raise StudyError(f"The folder {folder} cannot be used: {error.strerror}.") from None


def _log(outcome: Outcome, progress: str) -> None:
    if outcome.problem:
        logger.warning("%s failed (%s): %s", outcome.member.name, progress, outcome.problem)
    else:
        logger.info("%s: %.0f s (%s)", outcome.member.name, outcome.wall_s, progress)
