"""Files that are written whole or not at all, read again if they change, and the lock of a run."""

from __future__ import annotations

import csv
import fcntl
import hashlib
import logging
import os
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from functools import lru_cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from tactile_fem.errors import StudyError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

logger = logging.getLogger(__name__)

PART_SUFFIX = ".part"
_MM_PER_INCH, _LEAST_SHARE = 25.4, 0.75


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Provide a temporary path, which replaces `path` when the block ends without an error.

    Readers see either the old file or the new one, even if the writer is killed. An OSError names
    `path`.
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
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def write_arrays(path: Path, arrays: Mapping[str, ArrayLike], *, compressed: bool = False) -> None:
    """Write a NumPy archive of numbers and text; to compress it takes ten times as long."""
    import numpy as np

    values = {name: np.asarray(value) for name, value in arrays.items()}
    if any(array.dtype.hasobject for array in values.values()):
        raise ValueError(f"{path.name} takes arrays of numbers and text only")
    save: Callable[..., None] = np.savez_compressed if compressed else np.savez
    with atomic_write(path) as part, part.open("wb") as stream:
        save(stream, **values)


@dataclass(frozen=True)
class Print:
    """Width and dots per inch of figures; None: each figure's own."""

    width_mm: float | None = None
    dpi: int | None = None

    def layout(self, size_inches: Sequence[float], dpi: float) -> tuple[tuple[float, float], float]:
        """Return the size, inches, at which a figure is laid out, and its dots per inch then.

        It is at most a third wider than in print, where letters so have 3/4 of their size or more.
        """
        width, height = size_inches
        wanted = width if self.width_mm is None else self.width_mm / _MM_PER_INCH
        laid_out = max(wanted, min(width, wanted / _LEAST_SHARE))
        return (laid_out, height * laid_out / width), (self.dpi or dpi) * wanted / laid_out

    @contextmanager
    def used(self) -> Iterator[None]:
        """Have figures drawn and written so."""
        before = in_print.set(self)
        try:
            yield
        finally:
            in_print.reset(before)


in_print: ContextVar[Print] = ContextVar("in_print", default=Print())


def write_figure(path: Path, figure: Figure, dpi: float | None = None) -> None:
    """Write a figure as a PNG, as it is to be printed, otherwise with its own dots per inch."""
    wanted = in_print.get().dpi or dpi or figure.dpi
    size, dots = in_print.get().layout(figure.get_size_inches().tolist(), wanted)
    figure.set_size_inches(size)
    kept = {"dpi": (wanted, wanted)}  # in the file: others print it by them
    with atomic_write(path) as part:
        figure.savefig(part, format="png", dpi=dots, pil_kwargs=kept)


def write_table(path: Path, rows: Sequence[Any]) -> None:
    """Write rows as a CSV file with a heading.

    Parameters
    ----------
    path
        The file, which is replaced when all is written.
    rows
        At least one: dataclasses of one kind, or mappings with the same keys.
    """
    records = [dict(row) if isinstance(row, Mapping) else asdict(row) for row in rows]
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, records[0])
        writer.writeheader()
        writer.writerows(records)


def sha256(file: Path) -> str:
    """Return the hash of the content of a file."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def hashes(files: Mapping[str, Path]) -> dict[str, str]:
    """Return the SHA-256 of each file; it is empty where the file cannot be read."""
    found = dict.fromkeys(files, "")
    for key, file in files.items():
        with suppress(OSError):
            found[key] = sha256(file)
    return found


def check_unchanged(files: Mapping[str, Path], before: Mapping[str, str]) -> None:
    """Raise StudyError if a file has changed since `hashes` was evaluated."""
    for key, now in hashes(files).items():
        if now != before[key]:
            raise StudyError(f"{files[key]} was changed while it was read: start again.")


class _FromFiles(Hashable, Protocol):
    def files(self) -> dict[str, Path]: ...


def cached_by_content[S: _FromFiles, T](
    maxsize: int,
) -> Callable[[Callable[[S], T]], Callable[[S], T]]:
    """Cache a function of a section of a study by the section and the content of its files."""

    def decorate(function: Callable[[S], T]) -> Callable[[S], T]:
        @lru_cache(maxsize)
        def cached(section: S, content: tuple[tuple[str, str], ...]) -> T:
            result = function(section)
            check_unchanged(section.files(), dict(content))
            return result

        @wraps(function)
        def call(section: S) -> T:
            return cached(section, tuple(hashes(section.files()).items()))

        return call

    return decorate


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder against other runs, and create it if needed.

    If another process holds the lock, or the folder is not writable, this raises StudyError. The
    operating system releases the lock when the process ends, however it ends; the file that
    remains has no meaning.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stream = (folder / ".lock").open("a")
    except OSError as error:
        raise StudyError(
            f"The results folder {folder} is not writable: {error.strerror}."
        ) from None
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(
                f"Another run is writing into {folder}: wait for its end or choose another folder."
            ) from None
        except OSError as error:  # some network file systems
            logger.warning("%s: cannot be locked against a second run (%s)", folder, error.strerror)
        yield
