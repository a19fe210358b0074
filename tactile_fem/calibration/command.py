"""The commands that fit tissues and finger, and predict what the fitted finger does."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from tactile_fem.cli.options import Changes, Count, PositiveFloat, Ranks, with_mechanics
from tactile_fem.errors import StudyError
from tactile_fem.runtime import ranks


def fit(
    *measured: Path,
    indenter: Annotated[
        list[str] | None,
        Parameter(
            help='Indenter of raw curves: a kind of stimulus and its keys, plate or "sphere '
            'radius_mm=2"; one for all, or one for each in turn.'
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
            help="What to fit: a tissue, skin, a constant or a length, and its prior spread "
            "about the study's value: with subcutaneous.C20_MPa:3 one standard deviation is a "
            "factor of 3. May be repeated. By default, skin and subcutaneous constants.",
        ),
    ] = None,
    results: Path = Path("results/fit"),
    evaluations: Annotated[int, Parameter(validator=validators.Number(gte=2))] = 12,
    jobs: Count = 1,
    ranks_: Ranks = 1,
) -> None:
    """Fit tissues, and the shape of the finger, to measurements on a person.

    A CSV file is a raw curve, depth_mm and force_N, or a table with the columns indenter,
    speed_mm_s, depth_mm, force_N, sd_N, or indenter, speed_mm_s, depth_mm, place_mm, deflection_mm,
    sd_mm. Run again, it repeats no press.

    Parameters
    ----------
    measured
        CSV files with forces over depth or profiles of the skin.
    speed
        Speed of the press of raw curves in mm/s.
    sd
        Standard deviation of their forces in N; by default, 5 % of each and 1 % of the largest.
    study
        Study to start from, a file or a shipped one; by default, default values.
    results
        Folder for presses, tables and figure.
    evaluations
        Largest number of points to try.
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
    module = with_mechanics("tactile_fem.calibration.calibrate", ranks_)
    found = module.fit(
        start, experiments, results, parameters=names, jobs=jobs, evaluations=evaluations
    )
    if ranks.is_first():
        print(found)
        print(f"Tables, figure and study.toml are in {results}")


def predict(
    fitted: Path,
    study: Path | None = None,
    /,
    *,
    depth: list[PositiveFloat],
    changes: Changes = (),
    results: Path | None = None,
    jobs: Count = 1,
    ranks_: Ranks = 1,
) -> None:
    """Predict forces of a fitted finger on another stimulus, with the uncertainty of the fit.

    Parameters
    ----------
    fitted
        Folder of a fit.
    study
        Study with the stimulus and protocol.press_speed_mm_s; by default, that of the fit.
    depth
        Depth of the press in mm. May be repeated.
    results
        Folder for presses, table and figure; by default, predictions in that of the fit.
    jobs
        Parallel presses.
    """
    from tactile_fem import load_study
    from tactile_fem.calibration import posterior, prediction

    if wrong := [change for change in changes if not change.startswith(("stimulus.", "protocol."))]:
        raise StudyError(f'"{wrong[0]}" has no effect: finger and tissues are those of the fit.')
    own, saved = fitted / "study.toml", fitted / "posterior.json"
    if not saved.is_file():
        raise StudyError(f"{fitted} is not the folder of a fit: it has no {saved.name}.")
    known, place = posterior.Posterior.load(saved, str(saved)), results or fitted / "predictions"
    finger, other = load_study(own), load_study(study or own, changes)
    speed = other.protocol.press_speed_mm_s
    with_mechanics("tactile_fem.calibration.model", ranks_)
    found = prediction.predict(
        known, finger, other.stimulus, place, depth_mm=depth, speed_mm_s=speed, jobs=jobs
    )
    if ranks.is_first():
        print(f"{found}\nTable, figure and study are in {place}")
