"""A process, or its MPI ranks, that runs scans of a series one after the other.

It reads requests from its input, a line of JSON each, and answers each with a line of JSON after
the mark that it was given.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

from tactile_fem.errors import StoppedError, TactileError
from tactile_fem.runtime.logs import PACKAGE
from tactile_fem.runtime.ranks import on_root
from tactile_fem.series.units import are_beside, begin_with
from tactile_fem.simulation.course import Course
from tactile_fem.simulation.results import Results
from tactile_fem.simulation.run import scan
from tactile_fem.study import Study
from tactile_fem.study.file import load_study


class Worker:
    """Runs scans of a series' folder, which holds their study files; all ranks call."""

    def __init__(self, folder: Path, comm: MPI.Comm) -> None:
        self._folder, self._comm = folder, comm
        self._last: tuple[Study, Course] | None = None  # whose course the next scan may use

    def run(self, name: str, same: Sequence[str] = (), keep: bool = False) -> str:
        """Run a scan; return in one sentence why it failed, or nothing.

        Those named in `same` have its mechanics. With `keep` its displacements are kept for the
        next scan, which lies beside it.

        Raises
        ------
        StoppedError
            SIGTERM or SIGINT was received.
        """
        last, self._last = self._last, None
        try:
            study = load_study(self._folder / f"{name}.toml")
            on_root(self._comm, lambda: self._reuse_mechanics(study, self._folder / name, same))
            beside = last[1] if last and are_beside(last[0], study) else None
            course = Course(beside) if beside or keep else None
            scan(study, self._folder / name, comm=self._comm, course=course)
        except StoppedError:
            raise
        except (TactileError, OSError) as error:
            return str(error)
        if course and keep:
            course.beside = None
            self._last = last if course.is_empty else (study, course)
        return ""

    def _reuse_mechanics(self, study: Study, folder: Path, same: Sequence[str]) -> None:
        """Begin a scan that is not there with the mechanics of a complete one."""
        scans = (Results(self._folder / name) for name in same)
        if not folder.exists() and (source := next((s for s in scans if s.complete), None)):
            begin_with(source.folder, folder, study)


def serve(folder: Path, mark: str, comm: MPI.Comm) -> None:
    """Run scans until the input ends."""
    worker = Worker(folder, comm)
    while line := comm.bcast(sys.stdin.readline() if comm.rank == 0 else ""):
        problem = worker.run(**json.loads(line))
        if comm.rank == 0:
            print(f"{mark}{json.dumps(problem)}", flush=True)


if __name__ == "__main__":
    logging.getLogger(PACKAGE).addHandler(logging.NullHandler())  # the scans have logs of their own
    try:
        serve(Path(sys.argv[1]), sys.argv[2], MPI.COMM_WORLD)
    except TactileError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
