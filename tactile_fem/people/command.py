"""The command that scans with many fingers."""

from __future__ import annotations

from pathlib import Path

from tactile_fem.cli.options import (
    ONE_BY_ONE,
    Changes,
    Count,
    Scheduling,
    SeriesFolder,
    StudyFile,
    list_scans,
)
from tactile_fem.errors import TactileError


def people(
    study: StudyFile = None,
    /,
    *,
    number: Count,
    over: list[str] | None = None,
    changes: Changes = (),
    results: SeriesFolder = Path("results/people"),
    scheduling: Scheduling = ONE_BY_ONE,
) -> None:
    """Scan with many fingers, which differ as people do: see the table people of a study.

    Run again, it completes the missing scans; people of a smaller ensemble are the first of a
    larger one. Each scan has its own folder. Fingers that cannot be meshed or pressed are counted.
    It prints and draws medians and bands of people, differences between conditions within people,
    and the causes of the spread.

    Parameters
    ----------
    number
        Number of people.
    over
        Conditions under which all people are scanned: section.key=value,value,... May be
        repeated.
    """
    from tactile_fem import load_study, series
    from tactile_fem.people import Ensemble, begin_people, collect_people, run_people
    from tactile_fem.people import people as draw
    from tactile_fem.people.report import write_report

    conditions = series.sweep(over, study, changes) if over else load_study(study, changes)
    scans = draw(conditions, number)
    if scheduling.list_:
        return list_scans(begin_people(scans, results), results, scheduling.ranks)
    if scheduling.collect:
        outcomes = collect_people(scans, results)
    else:
        outcomes = run_people(scans, results, jobs=scheduling.jobs, ranks=scheduling.ranks)
    print(f"Written to {series.write_summary(scans, results)}")
    if failed := [outcome for outcome in outcomes if outcome.problem]:
        failures = f"{len(failed)} of {len(outcomes)} scans failed or have not run"
        print(f"{failures}: see {results}/summary.csv")
    if outcomes and len(failed) == len(outcomes):
        raise TactileError(failed[0].problem)
    ensemble = Ensemble.open(results)
    if ensemble.complete.any():
        print("\n".join(write_report(ensemble)))
