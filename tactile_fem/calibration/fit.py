"""The fit: which tissues, and which shape of the finger, make the model meet the measurements.

With the measured numbers ``m_k`` and their standard deviations ``s_k``, the model's numbers
``f_k(x)``, and the parameters' factors ``g_i`` it minimizes

    sum_k ((f_k(x) - m_k)/s_k)^2 + sum_i (x_i / ln g_i)^2,

where ``x_i`` is the logarithm of how much parameter i differs from the study. The second sum says
what is known without the measurements; where they say nothing, x stays 0. Derivatives along
constants of the tissues come with each press, see `calibration.sensitivity`; those along the
finger's lengths from a press of a finger with another length.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc, ndtri

from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.model import Model, Squares, deviations
from tactile_fem.calibration.parameters import Parameter, with_values
from tactile_fem.calibration.press import study_of
from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.files import locked
from tactile_fem.runtime.logs import each_once, shown
from tactile_fem.runtime.ranks import on_root
from tactile_fem.simulation.checks import check_study
from tactile_fem.study import Study

Array = NDArray[np.float64]

_TOLERANCE = 1e-3
# What describes the finger, which is often that of the press before.
_OF_FINGER = ("finger.settings", "finger.build", "mechanics.domain", "simulation.simulation")
_CONFIDENCE_SD = float(ndtri(0.975))  # 95 %


@dataclass(frozen=True)
class Fit:
    """A fit's result.

    Attributes
    ----------
    start, study
        The study before, and with the fitted values.
    parameters, experiments
        What was fitted, to what.
    x
        Logarithm of how much each parameter differs from the start, (parameters,).
    predicted
        The model's numbers at `x`, an array for each experiment.
    jacobian
        Derivatives of all experiments' numbers, in their standard deviations, (numbers,
        parameters).
    evaluations
        How many points the optimizer tried.
    message
        Why it ended.
    converged
        Whether it ended before the most points were tried.
    """

    start: Study
    study: Study
    parameters: tuple[Parameter, ...]
    experiments: tuple[Experiment, ...]
    x: Array
    predicted: tuple[Array, ...]
    jacobian: Array
    evaluations: int
    message: str
    converged: bool

    @property
    def deviations(self) -> Array:
        """Model less measurement, in standard deviations, (numbers,)."""
        return deviations(self.experiments, self.predicted)

    @property
    def squares(self) -> Squares:
        """What was minimized, at `x`."""
        known = [p.sd for p in self.parameters]
        return Squares(
            float(self.deviations @ self.deviations), float(np.sum((self.x / known) ** 2))
        )

    @property
    def chance(self) -> float:
        """Chance of squares as large as these, if the standard deviations of the input are right.

        A linear model's least sum follows chi squared with as many degrees of freedom as there are
        measured numbers: each parameter adds a square and takes a degree.
        """
        return float(chdtrc(len(self.deviations), self.squares.total))

    @property
    def covariance(self) -> Array:
        """Of `x`, (parameters, parameters).

        It takes the deviations as independent of each other, which those of one finger are not,
        and their standard deviations as known: intervals are a normal distribution's.
        """
        known = np.diag([1 / p.sd**2 for p in self.parameters])
        return np.linalg.inv(self.jacobian.T @ self.jacobian + known)

    @property
    def sd(self) -> Array:
        """Standard deviation of `x`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def intervals(self) -> Array:
        """Factors from the start to the ends of the 95 % intervals, (parameters, 2)."""
        return np.exp(self.x[:, None] + _CONFIDENCE_SD * self.sd[:, None] * [-1, 1])

    @property
    def learnt(self) -> Array:
        """How much of the variance before is gone: 0 nothing was learnt, 1 all is known."""
        return 1 - (self.sd / [p.sd for p in self.parameters]) ** 2

    @property
    def correlation(self) -> Array:
        """Of the parameters, (parameters, parameters)."""
        return self.covariance / np.outer(self.sd, self.sd)

    @property
    def pulls(self) -> Array:
        """How each measured number pulls, (numbers, parameters).

        Change of x, in its standard deviations, if the number were one of its own larger.
        """
        return (self.jacobian @ self.covariance) / self.sd


@shown()
def fit(
    study: Study,
    experiments: Sequence[Experiment],
    parameters: Sequence[Parameter],
    folder: Path | str,
    *,
    jobs: int = 1,
    evaluations: int = 12,
    comm: MPI.Comm | None = None,
) -> Fit:
    """Fit parameters to experiments.

    Every press is saved in the folder; a fit that was interrupted and is called again repeats none.

    Parameters
    ----------
    study
        Where it starts, and what is not fitted; its stimulus and protocol are not used.
    experiments, parameters
        See `read_measurements` and `parse_parameter`.
    folder
        For the presses.
    jobs
        Presses in parallel, each in a process of its own; with 1 all ranks of `comm` press.
    evaluations
        Most points to try.
    comm
        Communicator; all its ranks must call. Default: all ranks.

    Raises
    ------
    StudyError
        Bad input, before any press.
    TactileError
        The presses of the start do not reach the measured depths, or there are too few
        evaluations.
    """
    comm = comm or MPI.COMM_WORLD
    with each_once(*_OF_FINGER), ExitStack() as held:
        _check(study, experiments, parameters, jobs, comm)
        model = Model(study, experiments, parameters, Path(folder), jobs, comm, evaluations)
        on_root(comm, lambda: held.enter_context(locked(Path(folder))), share=False)
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
    return Fit(
        study,
        with_values(study, parameters, solution.x),
        tuple(parameters),
        tuple(experiments),
        solution.x,
        tuple(p.values for p in predicted),
        solution.jac[: -len(parameters)],
        int(solution.nfev),
        str(solution.message),
        solution.status > 0,
    )


def _check(
    study: Study,
    experiments: Sequence[Experiment],
    parameters: Sequence[Parameter],
    jobs: int,
    comm: MPI.Comm,
) -> None:
    study.finger.require_solid("a fit: measured forces are those of a whole finger")
    if not parameters:
        raise StudyError("A fit needs one or more parameters.")
    names = [key for parameter in parameters for key in parameter.powers]
    if len(set(names)) < len(names):
        raise StudyError("Two parameters of the fit change the same constant: name it once.")
    if jobs > 1 and comm.size > 1:
        raise StudyError(f"jobs is {jobs} but must be 1 on {comm.size} ranks.")
    for experiment in experiments:
        check_study(study_of(study, experiment))
