"""Atomic writing: files are written under a temporary name and then renamed."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PART_SUFFIX = ".part"


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Provide a temporary path, which replaces `path` when the block ends without an error.

    Readers see either the old file or the new one, even if the writer is killed.

    Raises
    ------
    OSError
        It cannot be written; names `path`.
    """
    part = path.with_name(f".{path.name}{PART_SUFFIX}")
    try:
        yield part
        with part.open("rb") as written:
            os.fsync(written.fileno())  # or a power cut could leave the new name empty
        os.replace(part, path)
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError):  # a full disk names no file, others the part
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


def write_figure(path: Path, figure: Figure, dpi: float | None = None) -> None:
    """Write a figure as a PNG, with matplotlib's dots per inch if none are given."""
    with replacing(path) as part:
        figure.savefig(part, format="png", dpi=dpi)


def write_table(path: Path, rows: Sequence[Any]) -> None:
    """Write equal dataclasses, at least one, as a CSV file with a heading."""
    write_records(path, [asdict(row) for row in rows])


def write_records(path: Path, records: Sequence[Mapping[str, Any]]) -> None:
    """Write dictionaries with the same keys, at least one, as a CSV file with a heading."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, records[0])
        writer.writeheader()
        writer.writerows(records)
