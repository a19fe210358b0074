"""The commands for series of scans: a thin layer over `tactile_fem.series`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter, validators

from tactile_fem.cli.options import Ranks, Settings, StudyFile, as_options
from tactile_fem.errors import TactileError
from tactile_fem.runtime import logs
from tactile_fem.study.file import load_study

if TYPE_CHECKING:
    from tactile_fem.series import Member

Folder = Annotated[Path, Parameter(help="Folder for the scans' folders and summary.csv.")]
Jobs = Annotated[int, Parameter(help="Parallel scans.", validator=validators.Number(gte=1))]
Share = Annotated[
    str, Parameter(help="Run only the K-th of N shares, K/N; for schedulers' job arrays.")
]


def sweep(
    study: StudyFile = None,
    /,
    *,
    over: Annotated[
        list[str],
        Parameter(
            negative="",
            consume_multiple=False,
            help="Values to combine: section.key=value,value,... May be repeated.",
        ),
    ],
    settings: Settings = None,
    results: Folder = Path("results/sweep"),
    jobs: Jobs = 1,
    ranks_: Ranks = 1,
    task: Share = "1/1",
) -> None:
    """Scan with every combination of the given values, and tabulate the results.

    Started again, it completes the missing scans. Each scan has its own folder and process.
    """
    from tactile_fem.series import sweep as members_of

    members = members_of(over, study, settings or ())
    _run(members, results, jobs, ranks_, task)


def fibre(
    study: StudyFile = None,
    /,
    *,
    spacing_mm: Annotated[float, Parameter(help="Shift between two passes.")] = 0.2,
    half_width_mm: Annotated[float, Parameter(help="Largest shift to either side.")] = 5.0,
    settings: Settings = None,
    results: Folder = Path("results/fibre"),
    jobs: Jobs = 1,
    ranks_: Ranks = 1,
    task: Share = "1/1",
) -> None:
    """Scan in passes over one receptor, with the stimulator shifted across the finger each time.

    Started again, it completes the missing passes. Each pass has its own folder and process.
    """
    from tactile_fem.series import single_fibre

    members = single_fibre(
        load_study(study, settings or ()), spacing_mm=spacing_mm, half_width_mm=half_width_mm
    )
    _run(members, results, jobs, ranks_, task)


def _run(members: Sequence[Member], folder: Path, jobs: int, ranks: int, task: str) -> None:
    from tactile_fem.series import run_series, write_summary

    logs.set_up()
    with as_options({"task is": "--task is"}):
        outcomes = run_series(members, folder, jobs=jobs, ranks=ranks, task=task)
    print(f"Written to {write_summary(members, folder)}")
    failed = [outcome for outcome in outcomes if outcome.problem]
    if failed:
        names = ", ".join(outcome.member.name for outcome in failed)
        raise TactileError(f"{len(failed)} of {len(outcomes)} scans failed: {names}")
