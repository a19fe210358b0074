"""Files that a study names, copied beside it: who reads it there needs no other file.

A copy's name ends in a hash of what the study calls the file. So a study file that is edited to
name another one finds no copy of it.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tactile_fem.runtime.files import atomic_write, sha256
from tactile_fem.runtime.own_code import Code
from tactile_fem.runtime.settings import Settings
from tactile_fem.stimulus.text import find_font

# Subfolder of the copies.
INPUTS = "inputs"
_DIGITS = 8
_MAX_STEM = 100  # characters of the name of a copy


def with_files[T](part: T, change: Callable[[str], str]) -> T:
    """Return a study, or a part of it, with other names of its files."""
    new: Any = part
    if isinstance(part, tuple):
        new = tuple(with_files(entry, change) for entry in part)
    elif isinstance(part, Code):
        new = part.moved(change)
    elif isinstance(part, Settings):
        values = {
            name: type(value)(change(str(value)))
            if name in part.file_keys() and value is not None
            else with_files(value, change)
            for name, value in part
        }
        changed = {name: value for name, value in values.items() if value != getattr(part, name)}
        new = part.model_copy(update=changed)
    return new


def named_files(study: Settings) -> list[str]:
    """Return the names of the files of a study: absolute paths, and path or family of a font."""
    names: list[str] = []

    def note(name: str) -> str:
        names.append(name)
        return name

    with_files(study, note)
    return names


def file_of(named: str) -> Path | None:
    """Return the file of an absolute path or of a font family; None if there is none."""
    found = named if Path(named).is_absolute() else find_font(named)
    if found is None:
        return None
    try:
        return Path(found) if Path(found).is_file() else None
    except OSError:  # in a folder that may not be read
        return None


def usable(named: str, folder: Path, *, though_changed: bool = True) -> str:
    """Return what to read for a file that the study in `folder` names.

    It is the file itself, or its copy if the file is gone, or has changed since and
    `though_changed` is true.
    """
    kept = _copy_of(named, folder)
    if kept is None:
        return named
    file = file_of(named)
    try:
        is_same = file is not None and sha256(file) == sha256(kept)
    except OSError:
        file, is_same = None, False
    return named if is_same or (file is not None and not though_changed) else str(kept)


def keep_files(study: Settings, folder: Path, *, afresh: bool) -> None:
    """Copy the files that a study names, and its font, into a subfolder of `folder`.

    Files that are not there, as where a script gives its own body, are left out. With `afresh`
    copies for an earlier study are replaced; without, what is missing is added.
    """
    inputs, written = folder / INPUTS, set()
    for named in named_files(study):
        file = file_of(named)
        is_kept = _copy_of(named, folder) is not None
        if file is None or (not afresh and (is_kept or file.parent == inputs)):
            continue
        inputs.mkdir(exist_ok=True)
        copy = inputs / f"{file.stem[:_MAX_STEM]}-{_digits(named)}{file.suffix}"
        with atomic_write(copy) as part:
            shutil.copyfile(file, part)
        written.add(copy)
    if not afresh or not inputs.is_dir():
        return
    for copy in set(inputs.glob(f"*-{_DIGITS * '[0-9a-f]'}*")) - written:
        copy.unlink()
    if not any(inputs.iterdir()):
        inputs.rmdir()


def content_of(named: str) -> str:
    """Return the hash of the content of a named file, or its name where there is none."""
    file = file_of(named)
    return named if file is None else sha256(file)


def _copy_of(named: str, folder: Path) -> Path | None:
    digits = _digits(named)
    found = (folder / INPUTS).glob(f"*-{digits}*")
    return next((path.absolute() for path in found if path.stem.endswith(digits)), None)


def _digits(named: str) -> str:
    return hashlib.sha256(named.encode(errors="surrogateescape")).hexdigest()[:_DIGITS]
