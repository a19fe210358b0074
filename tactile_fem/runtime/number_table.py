"""Numbers in rows of a text file, as programs of any language write them."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.runtime.text import read_text

Array = NDArray[np.float64]

_MISSING = {"", "bad", "na", "n/a", "#n/a", "nodata", "-", "--", "---", "***"}
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?|[-+]?(nan|inf|infinity)", re.I)
_DECIMAL_COMMA = re.compile(r"[-+]?\d*(,\d+)?([eE][-+]?\d+)?")
_MARKER = re.compile(r"no.?data(?:.?value)?\s*[:=]?\s*(\S+)", re.I)
_STATEMENT = re.compile(r"#.*[:=]")
_MAX_VALUES = 16_000_000
_LONGEST_LINE = 2000  # characters; of longer ones the first


class UnusableError(ValueError):
    """Why a file holds no numbers that can be used: what follows its name in a sentence."""


def check_count(shape: tuple[int, ...]) -> None:
    """Raise UnusableError if so many numbers do not fit into memory."""
    if np.prod([float(n) for n in shape]) > _MAX_VALUES:
        raise UnusableError(
            f"holds {' x '.join(map(str, shape))} numbers but may hold at most {_MAX_VALUES:,}: "
            "crop it or thin it out"
        )


def is_table(file: Path) -> bool:
    """Return whether a file is text whose first row has more numbers than three coordinates."""
    try:
        lines = read_text(file, "", western=True).split("\n")
    except StudyError:
        return False
    return any(len(_cells(line)) > 3 for line in lines[:100] if _is_row(line))


def read_table(file: Path, start: str) -> tuple[Array, list[str]]:
    """Return the numbers of a text file, and the lines before and after them.

    Cells are separated by commas, semicolons, tabs or blanks; numbers may have decimal commas, and
    words for missing numbers become NaN. A message on a file that is no text begins with `start`.

    Raises
    ------
    UnusableError
        It has no rows of numbers, too many, rows that differ in length, or other words in them.
    StudyError
        It is no text.
    """
    lines = read_text(file, start, western=True, binary="it is no text").split("\n")
    rows, header = _divided(lines)
    delimiter, decimal = _dialect(rows.values())
    if decimal == ",":
        rows = {number: line.replace(",", ".") for number, line in rows.items()}
    if delimiter and all(line.endswith(delimiter) for line in rows.values()):
        rows = {number: line[: -len(delimiter)] for number, line in rows.items()}
    row = next(iter(rows.values()))
    check_count((len(rows), row.count(delimiter) + 1 if delimiter else len(row.split())))
    values = _numbers(rows, delimiter)
    for line in header:
        if (found := _MARKER.search(line)) and _NUMBER.fullmatch(found[1]):
            values[values == float(found[1].replace(",", "."))] = np.nan
    return values, header


def _divided(lines: list[str]) -> tuple[dict[int, str], list[str]]:
    """Return the rows of numbers by the number of their line, and the other lines."""
    full = (k for k, line in enumerate(lines) if _is_row(line))
    if (first := next(full, None)) is None:
        raise UnusableError("cannot be read: it has no rows of numbers")
    last = next(k for k in reversed(range(len(lines))) if _is_row(lines[k]))
    second = next((k for k in range(first, last) if _STATEMENT.match(lines[k].lstrip())), None)
    if second is not None:
        raise UnusableError(f"holds several tables, the second from line {second + 1} on: keep one")
    rows = {
        k + 1: line.replace('"', "").rstrip(" ")
        for k, line in enumerate(lines[first : last + 1], first)
        if line.strip() and not line.lstrip().startswith("#")
    }
    return rows, [line for line in [*lines[:first], *lines[last + 1 :]] if line.strip()]


def _is_row(line: str) -> bool:
    """Return whether a line holds numbers and nothing else but words for missing ones."""
    cells = _cells(line)
    numbers = sum(_NUMBER.fullmatch(cell) is not None for cell in cells)
    return numbers > 0 and numbers + sum(cell.lower() in _MISSING for cell in cells) == len(cells)


def _cells(line: str) -> list[str]:
    """Return the cells of a line, of a long one the first."""
    cells = re.split(r"[;,\s]+", line[:_LONGEST_LINE].replace('"', "").strip(" \t;,"))
    return cells if len(line) <= _LONGEST_LINE else cells[:-1]


def _dialect(rows: Collection[str]) -> tuple[str | None, str]:
    """Return what separates cells, None for blanks and tabs, and the decimal mark."""
    if any(";" in row for row in rows):
        return ";", ","
    row = next((row for row in rows if "," in row), None)
    if row is None:
        return None, "."
    words = row.split()
    if len(words) > 1 and all(_DECIMAL_COMMA.fullmatch(w) or w.lower() in _MISSING for w in words):
        return None, ","
    return ",", "."


def _numbers(rows: dict[int, str], delimiter: str | None) -> Array:
    try:
        return np.loadtxt(list(rows.values()), delimiter=delimiter, ndmin=2, dtype=np.float64)
    except ValueError:
        pass  # a word for a missing number, or a mistake that is named below
    found, columns = [], 0
    for number, line in rows.items():
        cells = line.partition("#")[0].split(delimiter)
        columns = columns or len(cells)
        if len(cells) != columns:
            raise UnusableError(
                f"cannot be read: line {number} has {len(cells)} numbers, those before it {columns}"
            )
        found.append([_number(cell.strip(), number) for cell in cells])
    return np.array(found)


def _number(cell: str, line: int) -> float:
    try:
        return math.nan if cell.lower() in _MISSING else float(cell)
    except ValueError:
        raise UnusableError(f'cannot be read: "{cell[:30]}" in line {line} is no number') from None
