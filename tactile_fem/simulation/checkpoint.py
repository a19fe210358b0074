"""The checkpoint of a scan: when it is written, from what, and whether a scan may continue it."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from tactile_fem.errors import StudyError
from tactile_fem.mechanics.rows import Snapshot, gathered
from tactile_fem.results.results import Results
from tactile_fem.results.trace import Array
from tactile_fem.runtime.ranks import on_root
from tactile_fem.runtime.version import this_version
from tactile_fem.simulation.parts import changed_part
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.study import AFTER_MECHANICS
from tactile_fem.study.input_copies import with_files

# Counts up when the names or the meaning of a checkpoint's arrays change.
_FORMAT = 13
# Parts of a study that may change between two runs: they act after the mechanics, or the mesh's
# hash shows the change.
_FREE: dict[str, Any] = {**AFTER_MECHANICS, "output": True, "finger": {"mesh_file"}}
# Seconds between two checkpoints, at least, and the share of the time that writing them may take.
_INTERVAL_S, _SHARE = 3.0, 0.02
_ANOTHER_FOLDER = "run the study again in another folder."


class Checkpoints:
    """Saves the last accepted state so seldom that it costs little; all ranks call."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._unsaved: Snapshot = {}
        self._due_s = -math.inf

    @property
    def is_due(self) -> bool:
        """Whether it is time to save; the ranks' clocks may differ."""
        return time.perf_counter() >= self._due_s

    def keep(self, state: Snapshot) -> None:
        """Keep a state in memory, in place of the last one."""
        self._unsaved = state

    def save(self, write: Callable[[dict[str, Array]], None]) -> None:
        """Gather the last state, unless this is done, and `write` it on the first rank."""
        if not self._unsaved:
            return
        started = time.perf_counter()
        saved = gathered(self._unsaved)
        on_root(self._comm, lambda: write(saved))
        self._unsaved, ended = {}, time.perf_counter()
        self._due_s = ended + max(_INTERVAL_S, (ended - started) / _SHARE)


def origin_of(simulation: Simulation) -> dict[str, Any]:
    """Return what the checkpoints of a simulation are made from; on the first rank only.

    As arrays of a checkpoint: ``format`` and ``version``; ``study``, JSON of those parts of it
    that must not change, without the names of its files; ``mesh``, the hash of the finger's mesh;
    ``files``, JSON of the SHA-256 of each file that the parts were read from, by its key;
    ``own_parts``, JSON of `Parts.identity`.
    """
    return {
        "format": _FORMAT,
        "version": this_version(),
        "study": with_files(simulation.study, lambda _: "file").model_dump_json(exclude=_FREE),
        "mesh": simulation.finger.hash,
        "files": json.dumps(simulation.files),
        "own_parts": json.dumps(simulation.parts.identity()),
    }


def read_checkpoint(
    simulation: Simulation,
    results: Results,
    at_mm: float | None = None,
    at_s: float | None = None,
) -> dict[str, Array]:
    """Return the checkpoint of a results folder, or the state it kept at a place or time.

    All ranks call. Arrays of nodes and points are on the first rank, as `gathered` has them.

    Raises
    ------
    StudyError
        There is none, or it belongs to another version, study or mesh, or to other files or own
        parts.
    """
    saved: dict[str, Array] = {}

    def read() -> dict[str, Array]:
        saved.update(results.load_state(at_mm, at_s))
        _check_origin(saved, simulation, str(results.checkpoint_file))
        return {name: array if array.ndim < 2 else array[:0] for name, array in saved.items()}

    return on_root(simulation.comm, read) | saved


def _check_origin(saved: dict[str, Array], simulation: Simulation, file: str) -> None:
    """Raise StudyError unless a checkpoint was made from the same as those of this simulation."""
    now = origin_of(simulation)
    if int(saved.get("format", 0)) != _FORMAT:
        raise StudyError(
            f"{file} is from {saved.get('version', 'an older version')}. This is tactile_fem "
            f"{this_version()} and cannot continue it: {_ANOTHER_FOLDER}"
        )
    if changed := _differences(saved["study"], now["study"]):
        raise StudyError(
            f"study.toml has changed since {file} was written ({', '.join(changed)}): only "
            "neuron, afferents' feels and output may; run the changed study in another folder."
        )
    if str(saved["mesh"]) != now["mesh"]:
        raise StudyError(
            f"{file} belongs to another mesh than the study's: bring that mesh back, or "
            f"{_ANOTHER_FOLDER}"
        )
    for key in _differences(saved["files"], now["files"]):
        # The hash of the mesh shows those of the finger; output and what is felt may change.
        if not key.startswith(("finger.", "output.", "afferents.")):
            raise StudyError(
                f"{key} names a file that has changed since {file} was written: bring it back, "
                f"or {_ANOTHER_FOLDER}"
            )
    before = json.loads(str(saved["own_parts"]))
    if part := changed_part(before, simulation.parts.identity()):
        raise StudyError(
            f"{file} was written with {part}: give the same parts to resume, or run the scan "
            "again in another folder."
        )


def _differences(saved: Any, now: str) -> dict[str, tuple[Any, Any]]:
    """Return what two tables in JSON have by each name under which they differ, or None."""
    then, here = json.loads(str(saved)), json.loads(now)
    pairs = {name: (then.get(name), here.get(name)) for name in {**then, **here}}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
