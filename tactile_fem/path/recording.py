"""Measured places of a body and forces on a finger over time, from a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.path.loads import Array
from tactile_fem.runtime.text import read_rows

_TIME = "time_s"
PLACES = ("x_mm", "y_mm", "z_mm")
TURNS = ("rx_deg", "ry_deg", "rz_deg")
LOADS = ("fx_N", "fy_N", "fz_N", "tz_Nmm")
_KNOWN = (*PLACES, *TURNS, *LOADS)


@dataclass(frozen=True)
class Recording:
    """What a file holds.

    Attributes
    ----------
    time_s
        Increasing, (n,).
    columns
        Arrays (n,) by the names in `PLACES` (of the body's origin), `TURNS` (its rotation vector),
        and `LOADS` (forces on the finger, and torque about Z through the body's origin).
    """

    time_s: Array
    columns: dict[str, Array]

    def of(self, names: Sequence[str]) -> Array:
        """Return some columns, (n, names); zeros for those that the file lacks."""
        none = np.zeros_like(self.time_s)
        return np.column_stack([self.columns.get(name, none) for name in names])


def read_recording(file: Path, start: str = "protocol.path") -> Recording:
    """Return what a CSV file holds, whose first line names its columns.

    Parameters
    ----------
    file
        The file.
    start
        Key that names it, for messages.

    Raises
    ------
    StudyError
        It cannot be read, has other columns, less than two rows, a value that is no finite
        number, or times that do not increase.
    """
    rows = read_rows(file, f"{start}: {file}")
    heading = rows[0][1] if rows else ["empty"]
    names = [name.strip() for name in heading]
    is_known = names[0] == _TIME and {*names[1:]} <= {*_KNOWN}
    if not is_known or len(names) < 2 or len({*names}) < len(names):
        raise StudyError(
            f"{start}: the first line of {file} is {_shown(heading)} but must be {_TIME} and some "
            f"of {', '.join(_KNOWN)}."
        )
    values = np.array(
        [_numbers(row, len(names), f"{start}: line {line} of {file}") for line, row in rows[1:]]
    )
    if len(values) < 2:
        raise StudyError(
            f"{start}: {file} must have at least two rows of numbers but has {len(values)}."
        )
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if late.size:
        before, after = values[late[0] : late[0] + 2, 0]
        raise StudyError(
            f"{start}: {_TIME} in {file} must increase, but {after:g} follows {before:g} in "
            f"line {rows[late[0] + 2][0]}."
        )
    return Recording(values[:, 0], dict(zip(names[1:], values[:, 1:].T, strict=True)))


def _numbers(row: list[str], count: int, where: str) -> list[float]:
    try:
        values = [float(text) for text in row]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise StudyError(f"{where} is {_shown(row)} but must be {count} finite numbers.")
    return values


def _shown(row: list[str]) -> str:
    """Return a line of the file, short enough for a sentence."""
    text = " ".join(",".join(row).split())
    return text if len(text) <= 60 else text[:57] + "..."
