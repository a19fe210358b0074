"""The checkpoint of a scan: what it was made from, and whether a scan may continue it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from tactile_fem import __version__
from tactile_fem.errors import StudyError
from tactile_fem.scan.results import Results
from tactile_fem.scan.setup import Setup
from tactile_fem.scan.trace import Array
from tactile_fem.study import Mesh

# Counts up when the names or the meaning of a checkpoint's arrays change.
_FORMAT = 5
# Parts of a study that may change between two runs: they act after the mechanics, or a
# hash shows the change.
_FREE: dict[str, Any] = {
    "neuron": True,
    "afferents": {"__all__": {"neuron", "feels"}},
    "output": True,
    "finger": {"mesh_file"},
    "stimulus": {"file"},
}


@dataclass(frozen=True)
class Origin:
    """What a checkpoint was made from.

    Attributes
    ----------
    study
        JSON of those parts of the study that must not change.
    mesh
        Hash of the finger's mesh.
    own_parts
        See `Parts.identity`; and the file of a rigid part.
    """

    study: str
    mesh: str
    own_parts: dict[str, str]

    @classmethod
    def of(cls, setup: Setup) -> Origin:
        """Return what the checkpoints of a scan are made from; on the first rank only."""
        assert setup.finger is not None
        study = setup.study.model_dump_json(exclude=_FREE)
        return cls(study, setup.finger.hash, {**setup.parts.identity(), **_files(setup)})

    def stamp(self) -> dict[str, Any]:
        """Return it as arrays of a checkpoint."""
        own_parts = json.dumps(self.own_parts)
        return {"format": _FORMAT, "version": __version__, **vars(self), "own_parts": own_parts}

    def read(self, results: Results) -> dict[str, Array]:
        """Return the checkpoint of a results folder.

        Raises
        ------
        StudyError
            It belongs to another version, study, mesh or other own parts.
        """
        saved, file = results.load_checkpoint(), results.checkpoint_file
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


def _files(setup: Setup) -> dict[str, str]:
    """Return name and hash of the file from which the stimulator was made, if it was."""
    stimulus = setup.study.stimulus
    if setup.parts.body is not None or not isinstance(stimulus, Mesh):
        return {}
    content = hashlib.sha256(stimulus.file.read_bytes()).hexdigest()[:16]
    return {"stimulus.file": f"{stimulus.file.name} {content}"}
