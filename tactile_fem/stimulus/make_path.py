"""From the study's protocol to the path of the body."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.runtime.text import read_rows
from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.path import Path, Piece, follow, hold, lift, press, slide, vibrating
from tactile_fem.stimulus.protocol import AnyPiece, Follow, Hold, Lift, Press, Protocol, Slide

_COLUMNS = ["time_s", "x_mm", "y_mm", "z_mm"]
# Shares of the whole between two outputs.
_HOLD_OUTPUT, _FOLLOW_OUTPUT = 0.1, 0.01


def make_path(protocol: Protocol, deepest_mm: float) -> Path:
    """Return the path that a protocol states.

    Parameters
    ----------
    protocol
        The pieces.
    deepest_mm
        Depth at which a press to a force is given up.

    Raises
    ------
    StudyError
        A file cannot be read, or the path is not valid.
    """
    places = {p.file: read_places(p.file) for p in protocol.pieces if isinstance(p, Follow)}
    pieces = tuple(
        _vibrating(_piece(piece, deepest_mm, places), piece) for piece in protocol.pieces
    )
    first = protocol.pieces[0]
    start = places[first.file][1][0] if isinstance(first, Follow) else np.zeros(3)
    path = Path(pieces, start)
    path.check()
    return path


def _piece(
    piece: AnyPiece, deepest_mm: float, places_of: dict[FilePath, tuple[Array, Array]]
) -> Piece:
    match piece:
        case Press():
            depth = deepest_mm if piece.depth_mm is None else piece.depth_mm
            return press(depth, piece.speed_mm_s, until_N=piece.force_N)
        case Hold():
            output = piece.output_s or _HOLD_OUTPUT * piece.time_s
            return hold(piece.time_s, output, held_N=piece.force_N)
        case Slide():
            return slide(piece.by_mm, piece.speed_mm_s, piece.output_mm, held_N=piece.force_N)
        case Lift():
            return lift(piece.depth_mm, piece.speed_mm_s)
        case Follow():
            times, places = places_of[piece.file]
            return follow(times, places, piece.output_s or _FOLLOW_OUTPUT * np.ptp(times))


def _vibrating(made: Piece, piece: AnyPiece) -> Piece:
    """Return a piece with its vibration, if it has one."""
    wave = getattr(piece, "vibration", None)
    if wave is None:
        return made
    return vibrating(made, wave.frequency_Hz, wave.amplitude_mm, wave.direction)


def read_places(file: FilePath) -> tuple[Array, Array]:
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


def _numbers(row: list[str], line: int, file: FilePath) -> list[float]:
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
