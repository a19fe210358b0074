"""The checkpoint of a scan: what it was made from, and whether a scan may continue it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from tactile_fem import __version__
from tactile_fem.errors import StudyError
from tactile_fem.simulation.results import Results
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.simulation.trace import Array
from tactile_fem.study.kept import with_files

# Counts up when the names or the meaning of a checkpoint's arrays change.
_FORMAT = 11
# Parts of a study that may change between two runs: they act after the mechanics, or the mesh's
# hash shows the change.
_FREE: dict[str, Any] = {
    "neuron": True,
    "afferents": {"__all__": {"neuron", "feels"}},
    "output": True,
    "finger": {"mesh_file"},
}


@dataclass(frozen=True)
class Origin:
    """What a checkpoint was made from.

    Attributes
    ----------
    study
        JSON of those parts of the study that must not change, without the names of its files.
    mesh
        Hash of the finger's mesh.
    files
        SHA-256 of each file that finger, stimulus, font and path were read from, by its key.
    own_parts
        See `Parts.identity`.
    """

    study: str
    mesh: str
    files: dict[str, str]
    own_parts: dict[str, str]

    @classmethod
    def of(cls, simulation: Simulation) -> Origin:
        """Return what the checkpoints of a scan are made from; on the first rank only."""
        own = simulation
        assert own.finger is not None
        study = with_files(own.study, lambda _: "file").model_dump_json(exclude=_FREE)
        return cls(study, own.finger.hash, own.files, own.parts.identity())

    def stamp(self) -> dict[str, Any]:
        """Return it as arrays of a checkpoint."""
        texts = {"files": json.dumps(self.files), "own_parts": json.dumps(self.own_parts)}
        return {"format": _FORMAT, "version": __version__, **vars(self), **texts}

    def read(
        self, results: Results, at_mm: float | None = None, at_s: float | None = None
    ) -> dict[str, Array]:
        """Return the checkpoint of a results folder, or the state it kept at a place or time.

        Raises
        ------
        StudyError
            There is none, or it belongs to another version, study or mesh, or to other files or
            own parts.
        """
        saved, file = results.load_state(at_mm, at_s), results.checkpoint_file
        if int(saved.get("format", 0)) != _FORMAT:
            raise StudyError(
                f"{file} is from {saved.get('version', 'an older version')}. This is tactile_fem "
                f"{__version__} and cannot continue it: run the study again in another folder."
            )
        then, now = json.loads(str(saved["study"])), json.loads(self.study)
        changed = [name for name in {**then, **now} if now.get(name) != then.get(name)]
        if changed:
            raise StudyError(
                f"study.toml has changed since {file} was written ({', '.join(changed)}): only "
                "neuron, afferents' feels and output may; run the changed study in another folder."
            )
        if str(saved["mesh"]) != self.mesh:
            raise StudyError(
                f"{file} belongs to another mesh than the study's: bring that mesh back, or run "
                "the study again in another folder."
            )
        for key, then in json.loads(str(saved["files"])).items():
            if self.files.get(key) != then and not key.startswith("finger."):  # see the mesh's hash
                raise StudyError(
                    f"{key} names a file that has changed since {file} was written: bring it back, "
                    "or run the study again in another folder."
                )
        self._check_own_parts(json.loads(str(saved["own_parts"])), file)
        return saved

    def _check_own_parts(self, saved: dict[str, str], file: object) -> None:
        for name in dict.fromkeys([*saved, *self.own_parts]):
            then, now = (parts.get(name, "the study's") for parts in (saved, self.own_parts))
            # A script that is imported has another name, but computes the same.
            if then.split()[-1] != now.split()[-1]:
                raise StudyError(
                    f"{file} was written with a {name} that was {then}, now it is {now}: give the "
                    "same parts to resume, or run the scan again in another folder."
                )
