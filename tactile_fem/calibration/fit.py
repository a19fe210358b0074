"""Fits a finger to measurements and writes what was found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

from tactile_fem.calibration.calibrate import calibrate
from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import DEFAULT_PARAMETERS, parse_parameter
from tactile_fem.calibration.result import Calibration
from tactile_fem.calibration.tables import write_results
from tactile_fem.runtime.ranks import on_root
from tactile_fem.study import Study


def fit(
    study: Study,
    experiments: Sequence[Experiment],
    folder: Path | str,
    *,
    parameters: Sequence[str] = DEFAULT_PARAMETERS,
    jobs: int = 1,
    evaluations: int = 12,
    comm: MPI.Comm | None = None,
) -> Calibration:
    """Fit tissues, and the shape of the finger, to measurements of somebody's finger.

    Tables, a figure and the fitted ``study.toml`` are written into the folder. Every press is saved
    there; a fit that was interrupted and is called again repeats none. Print the result to read it.

    Parameters
    ----------
    study
        Where it starts, and what is not fitted; its stimulus and protocol are not used.
    experiments
        See `Experiment.of_curve` and `read_measurements`.
    folder
        For presses, tables and figure.
    parameters
        What to fit: a tissue, ``skin``, a constant or a length, with how far it may be from the
        study's: ``subcutaneous.C20_MPa:3`` is within a factor of 3 at one standard deviation.
        Default skin and the constants of subcutaneous tissue.
    jobs
        Presses in parallel, each in a process of its own; with 1 all ranks of `comm` press.
    evaluations
        Largest number of points to try.
    comm
        Communicator; all its ranks must call. Default: all ranks.

    Raises
    ------
    StudyError
        Bad input, before any press.
    TactileError
        The presses of the start do not reach the measured depths, or a length cannot be varied.
    """
    comm = comm or MPI.COMM_WORLD
    chosen = [parse_parameter(text, study) for text in parameters]
    found = calibrate(
        study, experiments, chosen, folder, jobs=jobs, evaluations=evaluations, comm=comm
    )
    on_root(comm, lambda: write_results(found, Path(folder)))
    return found
