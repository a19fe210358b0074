"""A piece that follows places in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from tactile_fem.errors import StudyError
from tactile_fem.path.motion import Array, Motion, MotionFrom, multiples
from tactile_fem.path.pieces import Piece
from tactile_fem.runtime.settings import File, Positive
from tactile_fem.runtime.text import read_rows

_COLUMNS = ["time_s", "x_mm", "y_mm", "z_mm"]
_OUTPUT_SHARE = 0.01  # of the whole, between two outputs


class Follow(Piece):
    """Follow places in a file.

    Its columns are ``time_s,x_mm,y_mm,z_mm``, linear in between. The first row of a path's first
    piece is where the body starts; later pieces go on from where the body is.
    """

    kind: Literal["follow"] = "follow"
    file: File = Field(description="a CSV file with the columns time_s,x_mm,y_mm,z_mm")
    output_s: Positive | None = Field(
        None, description="time between two outputs; not set: a hundredth of the whole"
    )

    def first_place(self) -> Array:
        """Return the first place, (3,) in mm."""
        return read_places(self.file)[1][0]

    def resolved(self, deepest_mm: float) -> MotionFrom:
        """Return the motion through the places that the file holds now."""
        times, places = read_places(self.file)
        times, shifts = times - times[0], places - places[0]
        outputs = multiples(self.output_s or _OUTPUT_SHARE * times[-1], times[-1])

        def motion(start_mm: Array) -> Motion:
            def place(t: float) -> Array:
                return start_mm + [np.interp(t, times, column) for column in shifts.T]

            return Motion("follow", float(times[-1]), place, outputs, times)

        return motion

    def motion(self, start_mm: Array) -> Motion:
        """Return the motion, shifted to begin at the start."""
        return self.resolved(np.inf)(start_mm)


def read_places(file: Path) -> tuple[Array, Array]:
    """Return times in s, (n,), and places in mm, (n, 3), of a CSV file.

    Raises
    ------
    StudyError
        It cannot be read, has other columns, less than two rows, a value that is no finite
        number, or times that do not increase.
    """
    rows = read_rows(file, f"protocol.path: {file}")
    heading = rows[0][1] if rows else ["empty"]
    if [name.strip() for name in heading] != _COLUMNS:
        raise StudyError(
            f"protocol.path: the first line of {file} is {_shown(heading)} but must be "
            f"{','.join(_COLUMNS)}."
        )
    values = np.array([_numbers(row, line, file) for line, row in rows[1:]])
    if len(values) < 2:
        raise StudyError(
            f"protocol.path: {file} must have at least two rows of numbers but has {len(values)}."
        )
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if late.size:
        before, after = values[late[0] : late[0] + 2, 0]
        raise StudyError(
            f"protocol.path: time_s in {file} must increase, but {after:g} follows {before:g} in "
            f"line {rows[late[0] + 2][0]}."
        )
    return values[:, 0], values[:, 1:]


def _numbers(row: list[str], line: int, file: Path) -> list[float]:
    try:
        values = [float(text) for text in row]
    except ValueError:
        values = []
    if len(values) != len(_COLUMNS) or not np.isfinite(values).all():
        raise StudyError(
            f"protocol.path: line {line} of {file} is {_shown(row)} but must be "
            f"{len(_COLUMNS)} finite numbers."
        )
    return values


def _shown(row: list[str]) -> str:
    """Return a line of the file, short enough for a sentence."""
    text = " ".join(",".join(row).split())
    return text if len(text) <= 60 else text[:57] + "..."
