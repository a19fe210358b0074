"""The command that fits tissues to measurements: a thin layer over `tactile_fem.calibration`."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.calibration.parameters import parse_parameter
from tactile_fem.cli.mechanics import with_mechanics
from tactile_fem.cli.options import Ranks, Settings, as_options
from tactile_fem.errors import StudyError
from tactile_fem.runtime import logs, ranks
from tactile_fem.runtime.signals import raise_stopped, signal_handler
from tactile_fem.study.file import load_study

_DEFAULT = ("skin", "subcutaneous.C10_MPa", "subcutaneous.C20_MPa", "subcutaneous.D1_per_MPa")


def fit(
    *measured: Annotated[
        Path, Parameter(help="CSV files with forces over depth or profiles of the skin.")
    ],
    study: Annotated[
        Path | None, Parameter(help="Study file to start from; default values without one.")
    ] = None,
    settings: Settings = None,
    parameters: Annotated[
        list[str] | None,
        Parameter(
            name="--fit",
            negative="",
            consume_multiple=False,
            help="What to fit: a tissue, skin, a constant or a length, with how far it may be "
            "from the study's: subcutaneous.C20_MPa:3 is within a factor of 3 at one standard "
            "deviation. May be repeated. Default skin and the constants of subcutaneous tissue.",
        ),
    ] = None,
    results: Annotated[Path, Parameter(help="Folder for presses, tables and figure.")] = Path(
        "results/fit"
    ),
    evaluations: Annotated[
        int, Parameter(help="Most points to try.", validator=validators.Number(gte=2))
    ] = 12,
    jobs: Annotated[
        int, Parameter(help="Parallel presses.", validator=validators.Number(gte=1))
    ] = 1,
    ranks_: Ranks = 1,
) -> None:
    """Fit tissues, and the finger's shape, to measurements of somebody's finger.

    A CSV file has the columns indenter, speed_mm_s, depth_mm, force_N, sd_N, or indenter,
    speed_mm_s, depth_mm, place_mm, deflection_mm, sd_mm. Started again, it repeats no press.
    """
    start = load_study(study, settings or ())
    experiments = read_measurements(measured)
    with as_options({"parameter ": "--fit "}):
        chosen = [parse_parameter(text, start) for text in parameters or _DEFAULT]
    if jobs > 1 and ranks_ > 1:
        raise StudyError(f"--jobs is {jobs} and --ranks {ranks_}, but one of them must be 1.")
    words = _arguments(measured, study, settings, parameters, results)
    words += ["--evaluations", str(evaluations)]
    module = with_mechanics("tactile_fem.calibration.fit", ranks_, words)
    rank = ranks.launched_rank() or 0
    logs.set_up(rank)
    with signal_handler(raise_stopped):
        found = module.fit(start, experiments, chosen, results, jobs=jobs, evaluations=evaluations)
    if rank == 0:
        report = import_module("tactile_fem.calibration.report")
        report.write_report(found, results)
        print(report.summary(found))
        print(f"Tables, figure and study.toml are in {results}")


def _arguments(
    measured: tuple[Path, ...],
    study: Path | None,
    settings: list[str] | None,
    parameters: list[str] | None,
    results: Path,
) -> list[str]:
    """Return the command's arguments for the ranks."""
    words = ["fit", *map(str, measured), "--results", str(results)]
    words += ["--study", str(study)] if study else []
    words += [word for setting in settings or () for word in ("--set", setting)]
    return words + [word for text in parameters or () for word in ("--fit", text)]
