"""Measured heights as a file holds them: arrays, tables and gray images.

The first row lies at the least X, the first column at the least Y: the picture, turned by a
quarter; its right is along Y. Nothing here runs code from a file, and what does not fit into memory
is refused by its header.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.runtime.number_table import UnusableError, check_count, read_table

if TYPE_CHECKING:
    from PIL import Image

LEAST_HEIGHTS = 4  # along an axis
_MAX_BYTES = 400_000_000


@dataclass(frozen=True)
class RawHeights:
    """Values (along X, along Y) as a file has them, and in mm, where it states them, sizes.

    They are the spacing along X and along Y, and the height of one unit of the values. A hint says
    in brackets why they may be unknown.
    """

    values: NDArray[Any]
    spacing_mm: tuple[float, float] | None = None
    unit_mm: float | None = None
    hint: str = ""


def read_raw(file: Path, key: str = "stimulus.file") -> RawHeights:
    """Return the heights of a file, which a study names with `key`.

    Raises
    ------
    StudyError
        There is none, it is too large, or cannot be read.
    """
    with reading(file, f"{key} = {file}"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a library's remarks on a format's details
        if (size := file.stat().st_size) > _MAX_BYTES:
            raise UnusableError(f"has {size:,} bytes but may have at most {_MAX_BYTES:,}")
        raw = HEIGHT_READERS.get(file.suffix.lower(), HEIGHT_READERS[""])(file)
        if raw.values.ndim != 2 or raw.values.dtype.kind not in "iuf":
            what = f"{raw.values.ndim} dimensions of {raw.values.dtype}"
            raise UnusableError(f"holds {what} but must hold real numbers in rows and columns")
        check_count(raw.values.shape)
    return raw


@contextmanager
def reading(file: Path, start: str) -> Iterator[None]:
    """Raise what goes wrong in reading a file as a StudyError that begins with `start`."""
    if not file.is_file():
        raise StudyError(f"{start}: there is no such file")
    try:
        yield
    except StudyError:
        raise
    except UnusableError as error:
        raise StudyError(f"{start} {error}") from None
    except Exception as error:  # each library has its own for what it cannot parse
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise StudyError(f"{start} cannot be read: {reason}") from None


def _array(file: Path) -> RawHeights:
    return RawHeights(np.lib.format.open_memmap(file, mode="r"))


def _table(file: Path) -> RawHeights:
    return RawHeights(read_table(file, f"stimulus.file = {file}")[0])


def _image(file: Path) -> RawHeights:
    from PIL import Image, ImageOps  # takes a while

    with Image.open(file) as image:
        check_gray(image)
        raw_mode = str(image.tile[0][3]) if image.tile else ""
        if raw_mode in ("L;2", "L;4"):
            raise UnusableError(f"has {raw_mode[-1]} bits a value but must have 8 or 16")
        return RawHeights(np.asarray(ImageOps.exif_transpose(image)))


def check_gray(image: Image.Image) -> None:
    """Raise UnusableError if an image is coloured, too large, or more than one."""
    is_gray = image.mode in ("L", "F", "I") or image.mode.startswith("I;16")
    if not is_gray or "transparency" in image.info:
        raise UnusableError(
            f"is an image of mode {image.mode} but must be gray, without colours, palette or "
            "transparency"
        )
    check_single(getattr(image, "n_frames", 1))
    check_count(image.size)


def check_single(images: int) -> None:
    """Raise UnusableError if a file holds several images."""
    if images > 1:
        raise UnusableError(f"holds {images} images but must be one")


def _unknown(file: Path) -> RawHeights:
    raise UnusableError(f'cannot be read: nothing reads files that end in "{file.suffix}"')


# By the ending of a file, in lower case; "" is any other. A companion adds or replaces some.
HEIGHT_READERS: dict[str, Callable[[Path], RawHeights]] = {
    ".npy": _array,
    **dict.fromkeys((".csv", ".txt", ".asc", ".dat"), _table),
    ".png": _image,
    "": _unknown,
}
