"""The commands that compute: scans and series of them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tactile_fem.cli.comparison import show_comparison
from tactile_fem.cli.options import (
    ONE_BY_ONE,
    Changes,
    Overwrite,
    Ranks,
    Scheduling,
    SeriesFolder,
    StudyFile,
    list_scans,
    with_mechanics,
)
from tactile_fem.errors import TactileError
from tactile_fem.runtime import ranks

if TYPE_CHECKING:
    from tactile_fem.series import Member, Outcome

logger = logging.getLogger(__name__)


def scan(
    study: StudyFile = None,
    /,
    *,
    changes: Changes = (),
    results: Path = Path("results/scan"),
    ranks_: Ranks = 1,
    overwrite: Overwrite = False,
) -> None:
    """Run a study and write data and pictures into a folder.

    Started again, an interrupted scan continues from its last checkpoint; of a finished one only
    the pictures are drawn again.
    Options such as -tactile_snes_rtol 1e-8 are passed to PETSc.

    Parameters
    ----------
    results
        Folder for data and pictures.
    overwrite
        Replace the scan in the folder; other files stay.
    """
    from tactile_fem import load_study

    the_study = load_study(study, changes)
    found = "nothing"
    if ranks.is_first():
        from tactile_fem.results.previous import earlier_scan

        found = earlier_scan(results, the_study, overwrite=overwrite)
    if found == "nothing":
        from tactile_fem.simulation.checks import check

        check(the_study)
    with_mechanics("tactile_fem.simulation.run", ranks_).scan(
        the_study, results, overwrite=overwrite
    )
    _finish(results)


def resume(results: Path, /, *, ranks_: Ranks = 1) -> None:
    """Continue a scan from its last checkpoint, on any number of ranks.

    Parameters
    ----------
    results
        Folder of an interrupted scan.
    """
    from tactile_fem import Results
    from tactile_fem.simulation.checks import check

    check(Results.open(results).study)
    with_mechanics("tactile_fem.simulation.run", ranks_).resume(results)
    _finish(results)


def _finish(folder: Path) -> None:
    """Draw the figures of a scan on the first rank."""
    if not ranks.is_first():
        return
    from tactile_fem import Results, draw

    found = Results.open(folder)
    pictures = draw(found) if found.study.output.pictures else []
    for path in pictures:
        print(path)
    print(f"Data {'and pictures ' if pictures else ''}are in {folder}")


# --- series --------------------------------------------------------------------------------------


def sweep(
    study: StudyFile = None,
    /,
    *,
    over: list[str],
    changes: Changes = (),
    results: SeriesFolder = Path("results/sweep"),
    scheduling: Scheduling = ONE_BY_ONE,
) -> None:
    """Scan with every combination of the given values, and compare the results.

    The table states differences from the first scan; histories are drawn on common axes. Run
    again, it completes the missing scans. Each scan has its own folder.

    Parameters
    ----------
    over
        Values to combine: section.key=value,value,... May be repeated.
    """
    from tactile_fem import series

    members = series.sweep(over, study, changes)
    if scheduling.list_:
        return list_scans(members, results, scheduling.ranks)
    outcomes = _run_series(members, results, scheduling)
    scans = {scan.folder.name: scan for scan in series.complete_scans(members, results)}
    if len(scans) > 1:
        show_comparison(scans, results / "comparison.png")
    _raise_failures(outcomes)


def fibre(
    study: StudyFile = None,
    /,
    *,
    spacing_mm: float = 0.2,
    half_width_mm: float = 5.0,
    changes: Changes = (),
    results: SeriesFolder = Path("results/fibre"),
    scheduling: Scheduling = ONE_BY_ONE,
) -> None:
    """Scan in passes over one receptor, with the stimulator shifted across the finger each time.

    Run again, it completes the missing passes. Each pass has its own folder.

    Parameters
    ----------
    spacing_mm
        Shift between two passes.
    half_width_mm
        Largest shift to either side.
    """
    from tactile_fem import load_study, series

    members = series.single_fibre(
        load_study(study, changes), spacing_mm=spacing_mm, half_width_mm=half_width_mm
    )
    if scheduling.list_:
        return list_scans(members, results, scheduling.ranks)
    _raise_failures(_run_series(members, results, scheduling))


def cluster(results: Annotated[Path, Parameter(help="Folder with the list.")], /) -> None:
    """Write a Snakefile, with which Snakemake runs a list of scans.

    sweep, fibre, people and reduce write the list with --list; the extra cluster installs
    Snakemake.
    """
    from tactile_fem import series

    print(f"Written to {series.write_snakefile(results)}")


def _run_series(members: Sequence[Member], folder: Path, scheduling: Scheduling) -> list[Outcome]:
    from tactile_fem import series

    if scheduling.collect:
        outcomes = series.collected(members, folder)
    else:
        outcomes = series.run_series(members, folder, jobs=scheduling.jobs, ranks=scheduling.ranks)
    print(f"Written to {series.write_summary(members, folder)}")
    return outcomes


def _raise_failures(outcomes: Sequence[Outcome]) -> None:
    failed = [outcome.member.name for outcome in outcomes if outcome.problem]
    if failed:
        names = ", ".join(failed)
        raise TactileError(
            f"{len(failed)} of {len(outcomes)} scans failed or have not run: {names}"
        )


COMMANDS = (scan, resume, sweep, fibre, cluster)
