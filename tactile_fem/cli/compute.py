"""The commands that compute: scans, series of them, fits and vibrations."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter, validators

from tactile_fem.cli.comparison import show_comparison
from tactile_fem.cli.options import (
    Changes,
    Collect,
    Count,
    ListScans,
    Overwrite,
    PositiveFloat,
    Ranks,
    ScanFolder,
    StudyFile,
    list_scans,
    with_mechanics,
)
from tactile_fem.errors import StudyError, TactileError
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
        from tactile_fem.simulation.earlier import earlier_scan

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

_SeriesFolder = Annotated[Path, Parameter(help="Folder for the scans' folders and summary.csv.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Scheduling:
    """How the scans of a series are run."""

    jobs: Annotated[Count, Parameter(help="Parallel scans.")] = 1
    ranks: Ranks = 1
    list_: ListScans = False
    collect: Collect = False


_ONE_BY_ONE = Scheduling()


def sweep(
    study: StudyFile = None,
    /,
    *,
    over: list[str],
    changes: Changes = (),
    results: _SeriesFolder = Path("results/sweep"),
    scheduling: Scheduling = _ONE_BY_ONE,
) -> None:
    """Scan with every combination of the given values, and compare the results.

    The table states differences to the first scan; histories are drawn on common axes. Started
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
    results: _SeriesFolder = Path("results/fibre"),
    scheduling: Scheduling = _ONE_BY_ONE,
) -> None:
    """Scan in passes over one receptor, with the stimulator shifted across the finger each time.

    Started again, it completes the missing passes. Each pass has its own folder.

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


def people(
    study: StudyFile = None,
    /,
    *,
    number: Count,
    over: list[str] | None = None,
    changes: Changes = (),
    results: _SeriesFolder = Path("results/people"),
    scheduling: Scheduling = _ONE_BY_ONE,
) -> None:
    """Scan with an ensemble of fingers, which differ as people do: see the table people of a study.

    Started again, it completes the missing scans; the first of a larger ensemble are a smaller one.
    Each scan has its own folder. A finger that cannot be meshed or pressed is counted. It prints
    medians and bands of people, differences between conditions within people and what the spread
    comes from, and draws them.

    Parameters
    ----------
    number
        Of people.
    over
        Conditions, in each of which all people are scanned: section.key=value,value,... May be
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


def cluster(results: Annotated[Path, Parameter(help="Folder of a series' list.")], /) -> None:
    """Put a Snakefile beside the list of a series, with which Snakemake runs its scans.

    The list is written by sweep, fibre, people or reduce with --list; Snakemake is in the extra
    cluster.
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


# --- fit -----------------------------------------------------------------------------------------


def fit(
    *measured: Path,
    indenter: Annotated[
        list[str] | None,
        Parameter(
            help='Of raw curves: a kind of stimulus and its keys, plate or "sphere radius_mm=2"; '
            "one for all, or one for each in turn."
        ),
    ] = None,
    speed: PositiveFloat | None = None,
    sd: PositiveFloat | None = None,
    study: Path | None = None,
    changes: Changes = (),
    parameters: Annotated[
        list[str] | None,
        Parameter(
            name="--fit",
            help="What to fit: a tissue, skin, a constant or a length, with how far it may be "
            "from the study's: subcutaneous.C20_MPa:3 is within a factor of 3 at one standard "
            "deviation. May be repeated. Default skin and the constants of subcutaneous tissue.",
        ),
    ] = None,
    results: Path = Path("results/fit"),
    evaluations: Annotated[int, Parameter(validator=validators.Number(gte=2))] = 12,
    jobs: Count = 1,
    ranks_: Ranks = 1,
) -> None:
    """Fit tissues, and the finger's shape, to measurements of somebody's finger.

    A CSV file is a raw curve, depth_mm and force_N, or a table with the columns indenter,
    speed_mm_s, depth_mm, force_N, sd_N, or indenter, speed_mm_s, depth_mm, place_mm, deflection_mm,
    sd_mm. Started again, it repeats no press.

    Parameters
    ----------
    measured
        CSV files with forces over depth or profiles of the skin.
    speed
        Of raw curves: speed of the press in mm/s.
    sd
        Of raw curves: standard deviation of a force in N; default 5 % of it and 1 % of the largest.
    study
        Study to start from, a file or a shipped one; default values if left out.
    results
        Folder for presses, tables and figure.
    evaluations
        Most points to try.
    jobs
        Parallel presses.
    """
    from tactile_fem import load_study
    from tactile_fem.calibration.measurements import read_measurements
    from tactile_fem.calibration.parameters import DEFAULT_PARAMETERS, parse_parameter

    start = load_study(study, changes)
    experiments = read_measurements(measured, indenters=indenter or (), speed_mm_s=speed, sd_N=sd)
    names = parameters or DEFAULT_PARAMETERS
    for name in names:
        parse_parameter(name, start)  # raises here, before ranks are started
    if jobs > 1 and ranks_ > 1:
        raise StudyError(f"--jobs is {jobs} and --ranks {ranks_}, but one of them must be 1.")
    module = with_mechanics("tactile_fem.calibration.calibrate", ranks_)
    found = module.fit(
        start, experiments, results, parameters=names, jobs=jobs, evaluations=evaluations
    )
    if ranks.is_first():
        print(found)
        print(f"Tables, figure and study.toml are in {results}")


# --- vibrate -------------------------------------------------------------------------------------


def vibrate(
    results: ScanFolder,
    /,
    *,
    frequencies: str = "1:1000:25",
    at_mm: float | None = None,
    at_s: float | None = None,
    moves: Literal["body", "bone"] = "body",
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0),
    amplitude_um: PositiveFloat = 10.0,
    shapes: Annotated[
        str | None,
        Parameter(
            help="Frequencies in Hz at which the finger's shape is kept and drawn: of those "
            "computed the nearest. Default the lowest, the middle and the highest."
        ),
    ] = None,
    ranks_: Ranks = 1,
) -> None:
    """Let the body or the bone vibrate about a state of a scan.

    Writes what receptors feel and how they fire over the frequency, and the finger's shape at some
    frequencies, into the folder's vibration/.

    Parameters
    ----------
    frequencies
        In Hz: low:high:count, evenly spaced in their logarithm, or a list.
    at_mm
        Displacement of a state kept by output.restarts; default the last state.
    at_s
        Its time, where several states lie at one displacement.
    moves
        What vibrates.
    direction
        X, Y and Z of the vibration.
    amplitude_um
        Amplitude for the table and the firing rates.
    """
    from tactile_fem import Results
    from tactile_fem.vibration import few_of, frequencies_of, nearest, unfelt

    wanted = frequencies_of(frequencies, "--frequencies")
    shaped = few_of(wanted) if shapes is None else frequencies_of(shapes, "--shapes")
    found = Results.open(results)
    found.load_state(at_mm, at_s)  # raises here if there is no such state
    module = with_mechanics("tactile_fem.vibration.vibrate", ranks_)
    for population in [afferents.population() for afferents in found.study.populations]:
        if reason := unfelt(population):
            logger.warning("%s afferents get no firing rates here: %s", population.name, reason)
    keeper = module.ModeKeeper(wanted[nearest(wanted, shaped)])
    spectrum = module.vibrate(
        results,
        wanted,
        at_mm=at_mm,
        at_s=at_s,
        moves=moves,
        direction=direction,
        observers=[keeper],
    )
    modes = keeper.modes()
    if ranks.is_first():
        from tactile_fem.output.spectrum import write_vibration

        for file in write_vibration(found, spectrum, modes, amplitude_um / 1000):
            print(file)


COMMANDS = (scan, resume, sweep, fibre, people, cluster, fit, vibrate)
