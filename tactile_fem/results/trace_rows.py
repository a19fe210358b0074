"""``trace.rows``: rows that a running scan has added to the histories since ``trace.npz``.

The header of an ``.npy`` file without entries, then a record for each row. It is read while it is
written; a record that a kill or a power cut left incomplete does not count.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.results.columns import OF_RECEPTOR
from tactile_fem.runtime.files import atomic_write

NAME = "trace.rows"

Array = NDArray[Any]

_HEADER_BYTES = 1_000_000  # more than the header of a thousand columns takes


class TraceRows:
    """Appends the rows of a trace; a process has one for a folder, on the first rank."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._dtype: np.dtype[Any] | None = None

    def begin(self, columns: Mapping[str, Array]) -> None:
        """Begin the file anew, for rows with columns like these, in place of what is there."""
        self._dtype = _dtype_of(columns)
        with atomic_write(self._path) as part, part.open("wb") as stream:
            none = np.empty(0, self._dtype)
            np.lib.format.write_array(stream, none, version=(3, 0), allow_pickle=False)

    def append(self, number: int, indented_s: float, columns: Mapping[str, Array]) -> bool:
        """Append a row, and return whether the file is for rows with its columns.

        Parameters
        ----------
        number
            Index of the row in the trace.
        indented_s
            End of the indentation as it is known now, on the clock of the path.
        columns
            The row's values by name.
        """
        dtype = _dtype_of(columns)
        if self._dtype is None or _joined(self._dtype, dtype) != self._dtype:
            return False
        record = np.array((number, indented_s, tuple(columns.values())), self._dtype)
        # Without creating it: if the folder was removed, the scan ends.
        with self._path.open("r+b") as stream:
            stream.seek(0, os.SEEK_END)
            stream.write(record.tobytes())
        return True

    def sync(self) -> None:
        """Wait until the rows are on the disk."""
        if self._dtype is not None:
            with self._path.open("rb") as stream:
                os.fsync(stream.fileno())


def _dtype_of(columns: Mapping[str, Array]) -> np.dtype[Any]:
    each = [(name, value.dtype, value.shape) for name, value in columns.items()]
    return np.dtype([("number", int), ("indented_s", float), ("columns", each)])


def _joined(one: np.dtype[Any], other: np.dtype[Any]) -> np.dtype[Any] | None:
    """Return the type that takes both rows, as of the longer name; None if columns differ."""
    try:
        return np.promote_types(one, other)
    except TypeError:
        return None


def read_rows(folder: Path) -> Array | None:
    """Return the records in a folder, of the rows that are complete; None if there are none.

    Read before ``trace.npz`` they join it, whatever the scan writes in between.

    Raises
    ------
    StudyError
        The file is damaged.
    """
    path = folder / NAME
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


def with_rows(saved: dict[str, Array], records: Array) -> dict[str, Array]:
    """Return the arrays of ``trace.npz`` with the rows that follow them."""
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
