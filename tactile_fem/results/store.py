"""The files of a results folder: how they are written, and read while a scan writes them.

A file is written beside and renamed. Only the trace grows: ``trace.rows`` has the rows since
``trace.npz``, the header of an ``.npy`` file without entries and then a record for each. A record
that a kill or a power cut left incomplete does not count.
"""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.results.columns import OF_RECEPTOR, check_trace
from tactile_fem.results.trace import Trace
from tactile_fem.runtime.files import atomic_write, write_arrays
from tactile_fem.study import DEFAULT_NAME

TRACE, ROWS = "trace.npz", "trace.rows"
# All files that the package writes, by their subfolder; nothing else is ever removed.
_OWN_FILES = {
    ".": (
        *("study.toml", "run.json", "trace.npz", "trace.rows", "spikes.csv"),
        *("checkpoint.npz", "stimulator.npz", "log.txt", "measured.csv"),
    ),
    "states": ("state_*.npz",),
    "fields": ("deformation.pvd", "deformation_*.vtu"),
    "figures": (
        *("sed.png", "raster.png", "firing.png", "force.png", "felt.png", "finger.png"),
        *("snapshots.png", "measured.png", "felt_*.png", "raster_*.png", "firing_*.png"),
        "deformation_*.png",
    ),
    "vibration": ("spectrum.*", "modes.npz", "shape_*_Hz.png"),
}
_PART_FILES = ".*.part"
_HEADER_BYTES = 1_000_000  # more than the header of a thousand columns takes
_NEEDED = ("time_s", "displacement_mm", "depth_mm", "force_N", "receptors_mm", "sed_kPa")

Array = NDArray[Any]


class Store:
    """A folder of files; one process writes it, on the first rank."""

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self._row_type: np.dtype[Any] | None = None

    @classmethod
    def create(cls, folder: Path | str, *, overwrite: bool = False) -> Self:
        """Make the folder ready to be written, with its parents.

        With `overwrite` what an earlier scan left there is removed; other files stay, and
        `save_study` replaces the files that its study named.

        Raises
        ------
        StudyError
            It is a file, is not writable, or is not empty and `overwrite` is false.
        """
        cls.check(folder, overwrite=overwrite)
        store = cls(folder)
        store._make()
        return store

    @staticmethod
    def check(folder: Path | str, *, overwrite: bool = False) -> None:
        """Raise what `create` would raise, as far as this is known without writing."""
        folder = Path(folder)
        try:
            if folder.is_dir():
                files = (path for path in folder.rglob("*") if path.is_file())
                if not overwrite and any(not path.name.startswith(".") for path in files):
                    raise StudyError(
                        f"The results folder {folder} is not empty: choose another one, or "
                        "overwrite the scan in it."
                    )
            elif folder.exists() or folder.is_symlink():
                raise StudyError(f"The results folder {folder} is a file: choose another name.")
            above = [folder.absolute(), *folder.absolute().parents]
            parent = next(path for path in above if path.exists())
            if not parent.is_dir():
                raise StudyError(f"The results folder {folder} cannot be made: {parent} is a file.")
            if not os.access(parent, os.W_OK | os.X_OK):
                raise StudyError(f"The results folder {folder} is not writable.")
        except OSError as error:
            raise StudyError(
                f"The results folder {folder} cannot be used: {error.strerror}."
            ) from None

    def _make(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                pass
            for name, patterns in _OWN_FILES.items():
                for pattern in (*patterns, _PART_FILES):
                    for path in (self.folder / name).glob(pattern):
                        path.unlink()
                if name != ".":
                    with suppress(OSError):  # it is not there, or holds files of the user
                        (self.folder / name).rmdir()
        except OSError as error:
            raise StudyError(
                f"The results folder {self.folder} is not writable: {error.strerror}."
            ) from None

    # --- arrays ---------------------------------------------------------------------------

    def load(self, name: str, *only: str) -> dict[str, Array]:
        """Return the arrays of a file, or only some of them."""
        path = self.folder / name
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return {key: arrays[key] for key in only or arrays}
        except FileNotFoundError:
            raise StudyError(f"There is no {path}: it has not been written yet.") from None
        except Exception as error:  # a damaged archive fails in many ways
            raise StudyError(f"{path} cannot be read: {error}.") from None

    # --- the trace ------------------------------------------------------------------------

    def save_trace(self, **arrays: ArrayLike) -> None:
        """Write ``trace.npz``: `tactile_fem.results.columns.TRACE`, and columns of observers.

        It replaces the rows that a running scan has added.
        """
        check_trace({name: np.asarray(array) for name, array in arrays.items()})
        write_arrays(self.folder / TRACE, arrays)
        (self.folder / ROWS).unlink(missing_ok=True)
        self.__dict__.pop("trace", None)

    def append_row(self, trace: Trace) -> bool:
        """Append the last row of a trace, and return True.

        The first row, and the first one of new columns or longer names, is written with all before
        it; the file then begins anew, for rows like it.
        """
        number, indented_s, columns = trace.last()
        each = [(name, value.dtype, value.shape) for name, value in columns.items()]
        row_type = np.dtype([("number", int), ("indented_s", float), ("columns", each)])
        path = self.folder / ROWS
        if self._row_type is None or not _takes(self._row_type, row_type):
            self.save_trace(**trace.arrays())
            self._row_type, none = row_type, np.empty(0, row_type)
            with atomic_write(path) as part, part.open("wb") as stream:
                np.lib.format.write_array(stream, none, version=(3, 0), allow_pickle=False)
            return False
        record = np.array((number, indented_s, tuple(columns.values())), self._row_type)
        # Without creating it: if the folder was removed, the scan ends.
        with path.open("r+b") as stream:
            stream.seek(0, os.SEEK_END)
            stream.write(record.tobytes())
        return True

    def sync_rows(self) -> None:
        """Wait until the rows are on the disk."""
        if self._row_type is not None:
            with (self.folder / ROWS).open("rb") as stream:
                os.fsync(stream.fileno())

    def load_trace(self) -> dict[str, Array]:
        """Return the arrays of ``trace.npz`` with the complete rows that follow them.

        Older folders have one population.
        """
        records = self._rows()  # before the trace: they join, whatever the scan writes in between
        trace = self.load(TRACE)
        missing = [name for name in _NEEDED if name not in trace]
        try:
            if missing:
                raise ValueError(f"it lacks {', '.join(missing)}")
            if records is not None:
                trace = _with_rows(trace, records)
            check_trace(trace)
        except ValueError as error:
            path = self.folder / TRACE
            raise StudyError(f"{path} is no trace of a scan: {error}.") from None
        return {"population": np.full(len(trace["receptors_mm"]), DEFAULT_NAME), **trace}

    def _rows(self) -> Array | None:
        path = self.folder / ROWS
        try:
            with path.open("rb") as stream:
                none = np.lib.format.read_array(
                    stream, allow_pickle=False, max_header_size=_HEADER_BYTES
                )
                return np.fromfile(stream, none.dtype)
        except FileNotFoundError:
            return None
        except Exception as error:  # a damaged file fails in many ways
            raise StudyError(f"{path} cannot be read: {error}.") from None


def _takes(records: np.dtype[Any], row: np.dtype[Any]) -> bool:
    try:
        return np.promote_types(records, row) == records
    except TypeError:  # columns differ
        return False


def _with_rows(saved: dict[str, Array], records: Array) -> dict[str, Array]:
    count = len(saved["time_s"])
    records = records[records["number"] >= count]
    follows = records["number"] == count + np.arange(len(records))
    records = records[np.logical_and.accumulate(follows)]
    columns = records["columns"]
    names = saved.keys() - {"time_s", *(column.name for column in OF_RECEPTOR)}
    if not len(records) or names != set(columns.dtype.names or ()):  # of an earlier run
        return saved
    joined = {name: np.concatenate([saved[name], columns[name]]) for name in names}
    return {**saved, **joined, "time_s": joined["clock_s"] - records["indented_s"][-1]}
