"""Calibration: which tissues and which shape of the finger make the model meet the measurements.

With the measured numbers ``m_k`` and their standard deviations ``s_k``, the model's numbers
``f_k(x)``, and the parameters' factors ``g_i`` it minimizes

    sum_k ((f_k(x) - m_k)/s_k)^2 + sum_i (x_i / ln g_i)^2,

where ``x_i`` is the logarithm of the ratio of parameter i to its value in the study. The second sum
is the knowledge without the measurements; where they say nothing, x is 0. Derivatives along
constants of the tissues come with each press, see `tactile_fem.calibration.sensitivity`; those
along lengths of the finger, and all those of a finger on its joint, from a press with other values.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.model import FINGER_LOGGERS, Model
from tactile_fem.calibration.parameters import (
    DEFAULT_PARAMETERS,
    Parameter,
    parse_parameter,
    with_values,
)
from tactile_fem.calibration.press import study_of
from tactile_fem.calibration.result import Calibration
from tactile_fem.calibration.tables import write_results
from tactile_fem.errors import StudyError, TactileError, raise_all
from tactile_fem.runtime.logs import each_once
from tactile_fem.runtime.session import session
from tactile_fem.simulation import check
from tactile_fem.study import Study

Array = NDArray[np.float64]

_TOLERANCE = 1e-3


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
    """Fit tissues, and the shape of the finger, to measurements on a person.

    Tables, a figure and the fitted ``study.toml`` are written into the folder. Every press is saved
    there; an interrupted fit, called again, repeats none. Print the result for a report.

    Parameters
    ----------
    study
        The study to start from; its stimulus and protocol are not used.
    experiments
        See `Experiment.of_curve` and `read_measurements`.
    folder
        Folder for presses, tables and figure.
    parameters
        What to fit: a tissue, ``skin``, a constant or a length, and its prior spread about the
        study's value: with ``subcutaneous.C20_MPa:3`` one standard deviation is a factor of 3. By
        default, skin and the constants of subcutaneous tissue.
    jobs
        Presses in parallel, each in a process of its own; with 1 all ranks of `comm` press.
    evaluations
        Largest number of points to try.
    comm
        Communicator; all its ranks must call. Default: all ranks.

    Returns
    -------
    Calibration
        Its ``study`` has the fitted values; ``constants()`` are those in MPa with their 95 %
        intervals.

    Raises
    ------
    StudyError
        Bad input, before any press.
    TactileError
        The presses of the start do not reach the measured depths, or a length cannot be varied.
    """
    place, chosen = Path(folder), [parse_parameter(text, study) for text in parameters]
    with session(comm) as run, each_once(*FINGER_LOGGERS):
        _check(study, experiments, chosen)
        model = Model(study, experiments, chosen, place, jobs, run.comm, evaluations)
        run.lock(place)
        found = _minimized(model, study, experiments, chosen, evaluations, place)
        run.on_root(lambda: write_results(found, place))
    return found


def _minimized(
    model: Model,
    study: Study,
    experiments: Sequence[Experiment],
    parameters: Sequence[Parameter],
    evaluations: int,
    folder: Path,
) -> Calibration:
    """Return the parameters with the least sum of squares."""
    start = np.zeros(len(parameters))
    if not np.isfinite(model.residuals(start)).all():
        raise TactileError(
            "A press of the study that the fit starts from does not reach the measured depths: "
            "start from other tissues, or leave the deepest measurements out."
        )
    solution = least_squares(
        model.residuals,
        start,
        jac=model.jacobian,
        x_scale=[p.sd for p in parameters],
        xtol=_TOLERANCE,
        ftol=_TOLERANCE,
        max_nfev=evaluations,
    )
    predicted = model.predictions(solution.x)
    return Calibration(
        start=study,
        study=with_values(study, parameters, solution.x),
        parameters=tuple(parameters),
        experiments=tuple(experiments),
        x=solution.x,
        predicted=tuple(p.values for p in predicted),
        curves=tuple(p.curve for p in predicted),
        jacobian=solution.jac[: -len(parameters)],
        evaluations=int(solution.nfev),
        converged=solution.status > 0,
        folder=folder,
    )


def _check(
    study: Study, experiments: Sequence[Experiment], parameters: Sequence[Parameter]
) -> None:
    study.finger.require_solid("a fit: measured forces are those of a whole finger")
    if not parameters:
        raise StudyError("A fit needs one or more parameters.")
    names = [key for parameter in parameters for key in parameter.powers]
    if len(set(names)) < len(names):
        raise StudyError("Two parameters of the fit change the same constant: name it once.")
    raise_all(*(partial(check, study_of(study, experiment)) for experiment in experiments))
