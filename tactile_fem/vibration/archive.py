"""Dataclasses of arrays as compressed NumPy archives."""

from __future__ import annotations

import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import atomic_write


def save_arrays(path: Path, arrays: Any) -> None:
    """Write all fields of a dataclass."""
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **vars(arrays))


def load_arrays[T](kind: type[T], path: Path) -> T:
    """Return the dataclass that `save_arrays` wrote.

    Raises
    ------
    StudyError
        It cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
            return kind(**{name: arrays[name] for name in names})
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise StudyError(f"{path} cannot be read as a vibration: {error}.") from None
