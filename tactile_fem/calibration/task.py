"""A press of a calibration: its file, named by all that determines it, and a process for it."""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

import numpy as np

import tactile_fem
from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.press import Prediction, press, study_of
from tactile_fem.calibration.sensitivity import Change
from tactile_fem.errors import TactileError
from tactile_fem.runtime.files import sha256, write_arrays, write_text
from tactile_fem.runtime.jobs import ERROR
from tactile_fem.runtime.ranks import on_root, raise_stopped, signal_handler
from tactile_fem.runtime.version import this_version
from tactile_fem.study import Study, content_of, dump_study, load_study, with_files


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
        kept = [one.name for one in fields(Prediction)]
        text = pressed + self._wanted() + repr(kept) + this_version() + _hash_of_code()
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def run(self, file: Path, comm: MPI.Comm = MPI.COMM_SELF) -> None:
        """Press and save what the model predicts; all ranks call."""
        prediction = press(self.study, self.experiment, self.changes, comm)
        on_root(comm, lambda: write_arrays(file, vars(prediction)))

    def write(self, file: Path) -> None:
        """Write the study of the press, and what is read of it, beside the file."""
        file.parent.mkdir(parents=True, exist_ok=True)
        write_text(file.with_suffix(".toml"), dump_study(study_of(self.study, self.experiment)))
        write_text(file.with_suffix(".json"), self._wanted())

    def _wanted(self) -> str:
        """Return where the press is read, and along which changes, as JSON."""
        return json.dumps(
            {
                "depth_mm": self.experiment.depth_mm.tolist(),
                "place_mm": self.experiment.place_mm.tolist(),  # NaN where a force is wanted
                "changes": [
                    [[*keys, power] for keys, power in sorted(change.items())]
                    for change in self.changes
                ],
            }
        )

    @classmethod
    def read(cls, file: Path) -> Task:
        """Return the press that was written beside a file; its measured numbers are unknown."""
        study = load_study(file.with_suffix(".toml"))
        wanted = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
        depth, place = np.array(wanted["depth_mm"]), np.array(wanted["place_mm"])
        speed, unknown = study.protocol.press_speed_mm_s, np.full(len(depth), np.nan)
        experiment = Experiment(file.stem, study.stimulus, speed, depth, place, unknown, unknown)
        changes = [{(law, name): power for law, name, power in one} for one in wanted["changes"]]
        return cls(study, experiment, tuple(changes))


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


if __name__ == "__main__":
    try:
        with signal_handler(raise_stopped):
            Task.read(Path(sys.argv[1])).run(Path(sys.argv[1]))
    except TactileError as error:
        sys.exit(f"{ERROR}{error}")
