"""Runs the scans of a series that are not complete, in workers side by side; tabulates it."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from tactile_fem.errors import StudyError, TactileError
from tactile_fem.output.histories import central_receptor, mean_over
from tactile_fem.runtime.files import write_table, write_text
from tactile_fem.runtime.logs import shown
from tactile_fem.runtime.ranks import signal_handler
from tactile_fem.series.members import Member
from tactile_fem.series.units import of_same_mechanics, units_of
from tactile_fem.series.workers import Outcome, run_units
from tactile_fem.simulation.checks import check_study
from tactile_fem.simulation.results import Results
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.kept import keep_files

logger = logging.getLogger(__name__)

_ROUNDING_S = 1e-12


def share_of(members: Sequence[Member], task: str) -> list[Member]:
    """Return the share of task ``K/N`` of a job array, K counted from 1: neighbours.

    Raises
    ------
    StudyError
        The task is not of this form, or K is not from 1 to N.
    """
    first, _, last = task.partition("/")
    if not (first.isdecimal() and last.isdecimal() and 1 <= int(first) <= int(last)):
        raise StudyError(f'task is "{task}" but must be K/N with K from 1 to N.')
    ends = [len(members) * k // int(last) for k in (int(first) - 1, int(first))]
    return list(members[slice(*ends)])


@shown()
def run_series(
    members: Sequence[Member],
    folder: Path | str,
    *,
    jobs: int = 1,
    ranks: int = 1,
    task: str = "1/1",
) -> list[Outcome]:
    """Run the scans that are not complete; one that fails does not stop the others.

    If interrupted and called again, it continues. Several tasks may share a folder, which holds a
    study file and a results folder for each scan, and ``….failed.txt`` if it failed. Scans that
    differ only in what follows the mechanics share it; those beside each other begin their steps
    from one another's, see `Course`.

    Parameters
    ----------
    jobs, ranks
        Number of scans in parallel, and of MPI processes for each.
    task
        The share ``K/N`` to run, see `share_of`; default all.

    Raises
    ------
    StudyError
        Bad input, before anything runs; or the folder contains another series.
    StoppedError
        SIGTERM or SIGINT was received; the running scans have been asked to stop.
    """
    folder = Path(folder)
    mine = share_of(members, task)
    for member in mine:
        check_study(member.study)
        _save_study(member, folder)
    left = [member for member in mine if not Results(folder / member.name).complete]
    outcomes = {member.name: Outcome(member, "", 0.0) for member in mine}
    for outcome in outcomes.values():
        keep_reason(outcome, folder)
    logger.info("%d scans, %d of them complete", len(mine), len(mine) - len(left))
    signals, begun = list[int](), time.perf_counter()
    groups = [[member.name for member in group] for group in of_same_mechanics(members)]
    same = {name: names for names in groups for name in names}
    running = run_units(units_of(left, jobs), same, folder, jobs, ranks, signals)
    with signal_handler(signals.append), closing(running):
        for done, outcome in enumerate(running, 1):
            outcomes[outcome.member.name] = outcome
            keep_reason(outcome, folder)
            minutes = (time.perf_counter() - begun) / done * (len(left) - done) / 60
            _log(outcome, f"{done} of {len(left)}, about {minutes:.0f} min left")
    return list(outcomes.values())


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


def complete_scans(members: Sequence[Member], folder: Path) -> list[Results]:
    """Return the results of the complete members, in the order of the members."""
    scans = [Results(folder / member.name) for member in members]
    return [scan for scan in scans if scan.complete]


def keep_reason(outcome: Outcome, folder: Path) -> None:
    """Write why a scan failed beside its folder; remove what an earlier run has written there."""
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


def numbers_of(results: Results) -> dict[str, int | float]:
    """Return cost and results of a scan: forces and SED of the slide, spikes, also by population.

    Forces and area are means over the time of the slide, which begins at the last step without
    displacement. Without a slide they are those of the step with the largest normal force, and SED
    and spikes are those of the whole path. Forces of a section are per width: their names end in
    ``N_per_mm``. The central receptor is that of the first population.
    """
    trace, spikes = results.trace, results.spikes
    sed, sliding = trace["sed_kPa"], spikes.time_s >= 0
    slid = np.flatnonzero(trace["displacement_mm"] > 0)
    if slid.size:
        slide = np.arange(max(slid[0] - 1, 0), len(sed))
        sed = sed[slide]
    else:
        slide, sliding = trace["force_N"][:, [2]].argmax(axis=0), np.isfinite(spikes.time_s)
    x, y, normal = trace["force_N"][slide].T
    loads = np.column_stack([normal, np.hypot(x, y), trace["contact_area_mm2"][slide]])
    means = mean_over(trace["time_s"][slide], loads).tolist()
    central = central_receptor(trace["receptors_mm"], trace["population"])
    by_name = {
        f"spikes_{afferents.name}": int((spikes.population[sliding] == afferents.name).sum())
        for afferents in results.study.afferents
    }
    unit = results.study.finger.force_unit.replace("/", "_per_")
    return {
        "steps": len(trace["time_s"]),
        "newton_iterations": int(trace["newton_iterations"].sum()),
        "wall_s": float(trace["wall_s"].sum()),
        f"pressed_{unit}": float(trace["force_N"][trace["time_s"] <= _ROUNDING_S][-1, 2]),
        f"normal_{unit}": means[0],
        f"tangential_{unit}": means[1],
        "contact_area_mm2": means[2],
        "largest_sed_kPa": float(sed.max()),
        "central_largest_sed_kPa": float(sed[:, central].max()),
        "spikes": int(sliding.sum()),
        "central_spikes": int((spikes.receptor[sliding] == central).sum()),
        **by_name,
    }


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
