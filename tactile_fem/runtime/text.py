"""Reads text as editors and spreadsheets write it; writes tables as lines."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterable, Sequence
from itertools import zip_longest
from pathlib import Path

from tactile_fem.errors import StudyError

# Encodings by byte order mark, the longer ones first: UTF-32's starts with UTF-16's.
_ENCODINGS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")


def read_text(
    file: Path, start: str, *, western: bool = False, binary: str = "not UTF-8 text"
) -> str:
    """Return the text of a file in UTF-8 or UTF-16, its lines ended by a newline.

    If it cannot be read, or is in another encoding, the message of the StudyError begins with
    `start`, such as "The study file a.toml", and ends with `binary` for a file without text. If
    `western`, bytes that are not UTF-8 are read as Windows-1252: where only ASCII and units matter.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise StudyError(f"{start} cannot be read: {error.strerror}.") from None
    encoding = _encoding(data)
    try:
        text = data.decode(encoding)
        if not text and encoding.startswith(("utf-16", "utf-32")):  # a mark and nothing else
            raise StudyError(f"{start} cannot be read: {binary}.")
    except UnicodeDecodeError as error:
        if b"\0" in data:
            raise StudyError(f"{start} cannot be read: {binary}.") from None
        if not western:
            line = data.count(b"\n", 0, error.start) + 1
            raise StudyError(
                f"{start} cannot be read: not UTF-8 text (byte 0x{data[error.start]:02x} in line "
                f"{line}). Save it with the encoding UTF-8."
            ) from None
        text = data.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _encoding(data: bytes) -> str:
    """Return the encoding by the byte order mark, or by the zeros of UTF-16 without one."""
    for mark, encoding in _ENCODINGS.items():
        if data.startswith(mark):
            return encoding
    low, high = data[0:1000:2], data[1:1000:2]
    if len(high) > 1 and not any(high) and all(low):
        return "utf-16-le"
    if len(low) > 1 and not any(low) and all(high):
        return "utf-16-be"
    return "utf-8"


def read_rows(file: Path, start: str) -> list[tuple[int, list[str]]]:
    """Return the rows of a CSV file that are not empty, each with the number of its line.

    Semicolons may separate the cells; numbers may then have decimal commas. A StudyError begins
    with `start`.
    """
    text = read_text(file, start, binary="it is no CSV file")
    heading = text.lstrip().partition("\n")[0]
    delimiter = ";" if ";" in heading and "," not in heading else ","
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    try:
        rows = [(reader.line_num, row) for row in reader if row]
    except csv.Error:
        raise StudyError(f"{start} cannot be read: it is no CSV file.") from None
    if delimiter == ";":
        rows = [(line, [_with_point(cell) for cell in row]) for line, row in rows]
    return rows


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def aligned(rows: Iterable[Sequence[str]]) -> list[str]:
    """Return a table as lines: names at the left, numbers at the right of their columns.

    A row of one cell is a line of its own.
    """
    rows = list(rows)
    columns = zip_longest(*(row for row in rows if len(row) > 1), fillvalue="")
    widths = [max(map(len, column)) for column in columns]
    return [
        "  ".join(
            cell.rjust(width) if k else cell.ljust(width if len(row) > 1 else 0)
            for k, (cell, width) in enumerate(zip(row, widths, strict=False))
        ).rstrip()
        for row in rows
    ]
