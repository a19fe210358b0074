"""The command that makes a fast finger."""

from __future__ import annotations

from pathlib import Path

from tactile_fem.cli.options import (
    Changes,
    Collect,
    Count,
    ListScans,
    Overwrite,
    StudyFile,
    Written,
    check_file,
    list_scans,
    with_mechanics,
)
from tactile_fem.errors import StudyError


def reduce(
    study: StudyFile = None,
    /,
    *,
    output: Written = Path("finger.npz"),
    scans: Count = 100,
    changes: Changes = (),
    results: Path = Path("results/reduce"),
    jobs: Count = 1,
    list_: ListScans = False,
    collect: Collect = False,
    overwrite: Overwrite = False,
) -> None:
    """Make a fast finger, which responds in milliseconds, from scans of a study's finger.

    The scans are of random shapes along random paths; run again, it completes the missing ones. The
    errors of the fast finger in scans not used in training are printed and stored in the file.

    Parameters
    ----------
    output
        The file, for tactile_fem.surrogate.FastFinger.
    scans
        Number of scans; each takes a minute or two.
    results
        Folder for the scans.
    jobs
        Parallel scans.
    overwrite
        Replace the file.
    """
    from tactile_fem import load_study

    check_file("--output", output, ".npz")
    if output.exists() and not overwrite:
        raise StudyError(f"{output} exists: choose another file, or --overwrite.")
    the_study = load_study(study, changes)
    module = with_mechanics("tactile_fem.surrogate.reduce", 1)
    if list_:
        return list_scans(module.wanted_scans(the_study, scans), results)
    finger = module.reduce_finger(the_study, results, scans=scans, jobs=jobs, collect=collect)
    finger.write(output)
    for name, value in finger.errors.items():
        print(f"{name}: {value:g}")
    print(f"Written to {output}")
