"""The folder of a scan: its own files, whether it may be written, and which state is meant."""

from __future__ import annotations

import logging
import os
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError

logger = logging.getLogger(__name__)

# All files that the package writes, by their subfolder; nothing else is ever removed.
_OWN_FILES = {
    ".": (
        *("study.toml", "run.json", "trace.npz", "trace.rows", "spikes.csv"),
        *("checkpoint.npz", "stimulator.npz", "log.txt", "measured.csv"),
    ),
    "states": ("state_*.npz",),
    "fields": ("deformation.pvd", "deformation_*.vtu"),
    "figures": (
        *("sed.png", "raster.png", "firing.png", "force.png", "felt.png"),
        *(
            "finger.png",
            "snapshots.png",
            "measured.png",
            "felt_*.png",
            "raster_*.png",
            "firing_*.png",
            "deformation_*.png",
        ),
    ),
    "vibration": ("spectrum.*", "modes.npz", "shape_*_Hz.png"),
}
_PART_FILES = ".*.part"
_TOLERANCE_MM, _TOLERANCE_S = 1e-6, 1e-6

Array = NDArray[np.float64]


def check_folder(folder: Path, *, overwrite: bool) -> None:
    """Raise StudyError if a scan cannot be written there, as far as this is known without writing.

    It may not be a file, nor hold files unless `overwrite` is true, and must be writable.
    """
    try:
        if folder.is_dir():
            if _has_files(folder) and not overwrite:
                raise StudyError(
                    f"The results folder {folder} is not empty: choose another one, or "
                    "overwrite the scan in it."
                )
        elif folder.exists() or folder.is_symlink():
            raise StudyError(f"The results folder {folder} is a file: choose another name.")
        parent = folder.absolute()
        while not parent.exists():
            parent = parent.parent
        if not parent.is_dir():
            raise StudyError(f"The results folder {folder} cannot be made: {parent} is a file.")
        if not os.access(parent, os.W_OK | os.X_OK):
            raise StudyError(f"The results folder {folder} is not writable.")
    except OSError as error:
        raise StudyError(f"The results folder {folder} cannot be used: {error.strerror}.") from None


def make_folder(folder: Path) -> None:
    """Create the folder with its parents, or remove what an earlier scan left in it.

    Raises
    ------
    StudyError
        It is not writable.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        for name, patterns in _OWN_FILES.items():
            for pattern in (*patterns, _PART_FILES):
                for path in (folder / name).glob(pattern):
                    path.unlink()
            if name != ".":
                with suppress(OSError):  # it is not there, or holds files of the user
                    (folder / name).rmdir()
    except OSError as error:
        raise StudyError(
            f"The results folder {folder} is not writable: {error.strerror}."
        ) from None


def _has_files(folder: Path) -> bool:
    """Return whether a folder has files other than hidden ones, also in its subfolders."""
    return any(path.is_file() and not path.name.startswith(".") for path in folder.rglob("*"))


def nearest_mm(displacement_mm: ArrayLike, at_mm: float, apart_mm: float) -> float:
    """Return the displacement of a kept state that is nearest to one.

    Raises
    ------
    StudyError
        It is farther away than the distance `apart_mm` of kept states; it has no subject.
    """
    kept = np.asarray(displacement_mm, dtype=float)
    nearest = float(kept[np.argmin(np.abs(kept - at_mm))])
    if not abs(nearest - at_mm) <= apart_mm:
        raise StudyError(f"has no state near {at_mm:g} mm: {_listed(kept, 'mm')}.")
    if abs(nearest - at_mm) > _TOLERANCE_MM:
        logger.info("the kept state at %g mm is the nearest to %g mm", nearest, at_mm)
    return nearest


def choose_state(
    displacement_mm: ArrayLike,
    time_s: ArrayLike,
    at_mm: float | None = None,
    at_s: float | None = None,
) -> int:
    """Return the number of the only state at a displacement, at a time, or at both.

    `displacement_mm` and `time_s` are those of the states that were kept, (states,). By the
    displacement alone, states from the end of the indentation on are preferred: before it the
    displacement is 0.

    Raises
    ------
    StudyError
        There is none, or several, as where the body holds and lifts; it has no subject.
    """
    slid, times = np.asarray(displacement_mm, dtype=float), np.asarray(time_s, dtype=float)
    there = np.full(len(times), True)
    wanted = []
    if at_mm is not None:
        there &= np.abs(slid - at_mm) < _TOLERANCE_MM
        wanted.append(f"{at_mm:g} mm")
    if at_s is not None:
        there &= np.isclose(times, at_s, rtol=1e-5, atol=_TOLERANCE_S)  # as messages round it
        wanted.append(f"{at_s:g} s")
    elif (there & (times > -_TOLERANCE_S)).any():
        there &= times > -_TOLERANCE_S
    found = np.flatnonzero(there)
    if len(found) == 1:
        return int(found[0])
    where = " and ".join(wanted)
    if len(found):
        listed = ", ".join(f"{time:.6g}" for time in times[found])
        raise StudyError(f"has several states at {where}: choose one by its time, {listed} s.")
    values, unit = (slid, "mm") if at_s is None else (times, "s")
    kept = _listed(values, unit) if len(values) else "set output.restarts for the scan"
    raise StudyError(f"has no state at {where}: {kept}.")


def _listed(values: Array, unit: str) -> str:
    """Return in words which states there are."""
    each = ", ".join(f"{value:.6g}" for value in dict.fromkeys(values.tolist()))
    return f"states were kept at {each} {unit}"
