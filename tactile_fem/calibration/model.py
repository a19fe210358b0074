"""The model as a function of the parameters of a calibration; every press is saved."""

from __future__ import annotations

import hashlib
import logging
import math
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, fields
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import tactile_fem
from tactile_fem.calibration.measurements import Experiment, deviations
from tactile_fem.calibration.parameters import Parameter, with_values
from tactile_fem.calibration.press import Prediction, press, study_of
from tactile_fem.calibration.sensitivity import Change
from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.files import sha256, write_arrays, write_text
from tactile_fem.runtime.ranks import on_root
from tactile_fem.study import Study
from tactile_fem.study.file import dump_study
from tactile_fem.study.kept import content_of, with_files

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Change of a length's logarithm for its derivative: far above the effect of another mesh.
_LENGTH_STEP = 0.05


@dataclass(frozen=True)
class Task:
    """A press that is wanted, and its file."""

    study: Study
    experiment: Experiment
    changes: tuple[Change, ...]

    @property
    def name(self) -> str:
        """Name of its file: a hash of everything that determines the press."""
        pressed = dump_study(with_files(study_of(self.study, self.experiment), content_of))
        wanted = [self.experiment.depth_mm, self.experiment.place_mm]
        changes = [sorted(change.items()) for change in self.changes]
        kept = [one.name for one in fields(Prediction)]
        text = pressed + repr([array.tolist() for array in wanted]) + repr([changes, kept])
        text += tactile_fem.__version__ + _hash_of_code()
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def run(self, file: Path, comm: MPI.Comm = MPI.COMM_SELF) -> None:
        """Press and save what the model predicts, and beside it the study; all ranks call."""
        prediction = press(self.study, self.experiment, self.changes, comm)

        def save() -> None:
            pressed = dump_study(study_of(self.study, self.experiment))
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file.with_suffix(".toml"), pressed)
            write_arrays(file, vars(prediction))

        on_root(comm, save)


@cache
def _hash_of_code() -> str:
    """Return a hash of the package, with which forces may change as with the study."""
    package = Path(tactile_fem.__file__).parent
    files = sorted(file for kind in ("*.py", "*.c") for file in package.rglob(kind))
    return hashlib.sha256("".join(map(sha256, files)).encode()).hexdigest()


def load(file: Path) -> Prediction:
    """Return a saved prediction."""
    with np.load(file, allow_pickle=False) as saved:
        return Prediction(**saved)


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
        self._study, self._experiments, self._parameters = study, experiments, parameters
        self._folder, self._jobs, self._comm = folder / "presses", jobs, comm
        self._evaluations, self._seen = evaluations, set[bytes]()
        self._pressed, self._spent_s = 0, 0.0  # without presses that were saved before
        self._changes = tuple(p.change for p in parameters if p.of_tissue)
        self._prior_sd = np.array([p.sd for p in parameters])

    def residuals(self, x: Array) -> Array:
        """Return deviations of the numbers, then of the parameters, in standard deviations."""
        is_new = x.tobytes() not in self._seen
        self._seen.add(x.tobytes())
        try:
            values = [p.values for p in self.predictions(x)]
        except StudyError as error:  # an impossible length
            logger.info("no finger there: %s", error)
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

    def predictions(self, x: Array, *, with_derivatives: bool = True) -> list[Prediction]:
        """Return what the model gives for each experiment."""
        changes = self._changes if with_derivatives else ()
        study = with_values(self._study, self._parameters, x)
        tasks = [Task(study, experiment, changes) for experiment in self._experiments]
        files = [self._folder / f"{task.name}.npz" for task in tasks]
        left = on_root(self._comm, lambda: [k for k, file in enumerate(files) if not file.exists()])
        begun = time.perf_counter()
        if self._jobs > 1:
            # MPI does not survive a fork.
            with ProcessPoolExecutor(self._jobs, get_context("spawn")) as pool:
                waiting = [pool.submit(tasks[k].run, files[k]) for k in left]
                try:
                    for done in as_completed(waiting):
                        done.result()
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
        else:
            for k in left:
                tasks[k].run(files[k], self._comm)
        self._pressed += len(left)
        self._spent_s += time.perf_counter() - begun
        return on_root(self._comm, lambda: [load(file) for file in files])

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of `residuals`, (numbers + parameters, parameters).

        Raises
        ------
        TactileError
            A finger with another length cannot be pressed as deep.
        """
        predictions = self.predictions(x)
        here = np.concatenate([p.values for p in predictions])
        of_tissue = iter(np.concatenate([p.derivatives for p in predictions]).T)
        columns = [
            next(of_tissue) if parameter.of_tissue else self._along_length(x, i, here)
            for i, parameter in enumerate(self._parameters)
        ]
        sd = np.concatenate([e.sd for e in self._experiments])
        return np.vstack([np.array(columns).T / sd[:, None], np.diag(1 / self._prior_sd)])

    def _along_length(self, x: Array, i: int, here: Array) -> Array:
        """Return the derivatives of the numbers, `here` at x, from a longer or shorter length."""
        for step in (_LENGTH_STEP, -_LENGTH_STEP):
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
        lengths = sum(not parameter.of_tissue for parameter in self._parameters)
        further = (self._evaluations - len(self._seen)) * (1 + lengths) + lengths
        left_s = further * len(self._experiments) * self._spent_s / self._pressed
        return f"at most {left_s / 60:.0f} min left"
