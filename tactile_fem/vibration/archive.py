"""Dataclasses of arrays in compressed NumPy archives."""

from __future__ import annotations

import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any, Self, cast

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import atomic_write


class Archived:
    """A dataclass of arrays with a file of them."""

    def save(self, path: Path) -> None:
        """Write all fields as a compressed NumPy archive."""
        with atomic_write(path) as part, part.open("wb") as stream:
            np.savez_compressed(stream, **vars(self))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Return what `save` wrote; StudyError if it cannot be read."""
        try:
            with np.load(path, allow_pickle=False) as arrays:
                names = [field.name for field in fields(cast(Any, cls))]
                return cls(**{name: arrays[name] for name in names})
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise StudyError(f"{path} cannot be read as a vibration: {error}.") from None
