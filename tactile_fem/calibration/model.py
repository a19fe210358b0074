"""The model as a function of the parameters of a calibration; every press is saved."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from tactile_fem.calibration.measurements import Experiment, deviations
from tactile_fem.calibration.parameters import Parameter, with_values
from tactile_fem.calibration.press import Prediction
from tactile_fem.calibration.task import Task, load
from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.jobs import Job, running
from tactile_fem.runtime.ranks import on_root
from tactile_fem.study import Study

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Change of a parameter for its derivative by another press: far above the effect of another mesh,
# and of loads on a joint, which are balanced within 0.1 %.
_STEP = 0.05
# Loggers of what describes the finger, which is often that of the press before.
FINGER_LOGGERS = ("finger.finger", "finger.build", "mechanics.domain", "simulation.simulation")


class Model:
    """Residuals and their derivatives as functions of the parameters; no press is repeated.

    For its arguments see `tactile_fem.calibration.calibrate.fit`.
    """

    def __init__(
        self,
        study: Study,
        experiments: Sequence[Experiment],
        parameters: Sequence[Parameter],
        folder: Path,
        jobs: int,
        comm: MPI.Comm,
        evaluations: int,
    ) -> None:
        if jobs > 1 and comm.size > 1:
            raise StudyError(f"jobs is {jobs} but must be 1 on {comm.size} ranks.")
        self._study, self._experiments, self._parameters = study, experiments, parameters
        self._folder, self._jobs, self._comm = folder / "presses", jobs, comm
        self._evaluations, self._seen = evaluations, set[bytes]()
        self._pressed, self._spent_s = 0, 0.0  # without presses that were saved before
        # Sensitivities are those at a fixed bone.
        self._is_sensitive = [p.of_tissue and not study.joint for p in parameters]
        self._changes = tuple(
            p.change for p, own in zip(parameters, self._is_sensitive, strict=True) if own
        )
        self._prior_sd = np.array([p.sd for p in parameters])

    def residuals(self, x: Array) -> Array:
        """Return deviations of the numbers, then of the parameters, in standard deviations."""
        is_new = x.tobytes() not in self._seen
        self._seen.add(x.tobytes())
        try:
            values = [p.values for p in self.predictions(x)]
        except StudyError as error:  # an impossible length
            logger.info("no finger can be made at this point: %s", error)
            values = [np.full_like(e.mean, np.nan) for e in self._experiments]
        numbers, prior = deviations(self._experiments, values), x / self._prior_sd
        if is_new:
            logger.info(
                "point %d of at most %d, %s: sum of squares %.4g; %s",
                *(len(self._seen), self._evaluations, self._time_left()),
                float(numbers @ numbers + prior @ prior),
                ", ".join(
                    f"{p.name} {p.value(self._study) * math.exp(at):.3g} {p.unit}"
                    for p, at in zip(self._parameters, x, strict=True)
                ),
            )
        return np.concatenate([numbers, prior])

    def predictions(self, *points: Array, with_derivatives: bool = True) -> list[Prediction]:
        """Return what the model gives at each point x for each experiment."""
        changes = self._changes if with_derivatives else ()
        studies = [with_values(self._study, self._parameters, x) for x in points]
        tasks = [Task(s, experiment, changes) for s in studies for experiment in self._experiments]
        files = [self._folder / f"{task.name}.npz" for task in tasks]
        left = on_root(self._comm, lambda: [k for k, file in enumerate(files) if not file.exists()])
        begun = time.perf_counter()
        for k in left:
            on_root(self._comm, partial(tasks[k].write, files[k]))
        if self._jobs > 1:
            self._run_beside([files[k] for k in left])
        else:
            for k in left:
                tasks[k].run(files[k], self._comm)
        self._pressed += len(left)
        self._spent_s += time.perf_counter() - begun
        return on_root(self._comm, lambda: [load(file) for file in files])

    def _run_beside(self, files: Sequence[Path]) -> None:
        """Make the presses that were written, side by side.

        Raises TactileError if one failed, StoppedError if SIGTERM or SIGINT was received.
        """
        jobs = [Job(file.stem, "tactile_fem.calibration.task", (str(file),)) for file in files]
        with running([jobs], self._jobs) as presses:
            for ended in presses:
                if ended.problem:
                    raise TactileError(ended.problem)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of `residuals`, (numbers + parameters, parameters).

        Raises TactileError if a finger with another value cannot be pressed as deep.
        """
        predictions = self.predictions(x)
        here = np.concatenate([p.values for p in predictions])
        sensitivities = iter(np.concatenate([p.derivatives for p in predictions]).T)
        columns = [
            next(sensitivities) if is_sensitive else self._difference(x, i, here)
            for i, is_sensitive in enumerate(self._is_sensitive)
        ]
        sd = np.concatenate([e.sd for e in self._experiments])
        return np.vstack([np.array(columns).T / sd[:, None], np.diag(1 / self._prior_sd)])

    def _difference(self, x: Array, i: int, here: Array) -> Array:
        """Return the derivatives of the numbers, `here` at x, by presses with another value."""
        for step in (_STEP, -_STEP):
            found = self.predictions(x + step * np.eye(len(x))[i], with_derivatives=False)
            column = (np.concatenate([p.values for p in found]) - here) / step
            if np.isfinite(column).all():
                return column
        raise TactileError(
            f"{self._parameters[i].name} cannot be fitted: with 5 % more or less of it a press "
            "does not reach the measured depths."
        )

    def _time_left(self) -> str:
        """Return the remaining time if all presses that may be needed are still to be made."""
        if not self._pressed:
            return "pressed before"
        others = self._is_sensitive.count(False)
        further = (self._evaluations - len(self._seen)) * (1 + others) + others
        left_s = further * len(self._experiments) * self._spent_s / self._pressed
        return f"at most {left_s / 60:.0f} min left"
