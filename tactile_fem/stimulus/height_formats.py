"""Formats of measured heights, and how a map of each lies under the finger.

Seen from above, with X to the right and Y upwards, no map may become its mirror image:

========================================  ==========================================================
``.npy .npz .mat .h5``, tables, images    first row at the least X, first column at the least Y: the
                                          picture, turned by a quarter; its right is along Y
``x3p sdf nc xyz nmm``                    they state coordinates, or are right-handed by their
                                          standard (ISO 25178-71, -72): their x and y are X and Y
all other instruments' files              a picture, first row on top: its right is X, its top is Y
========================================  ==========================================================

Nothing here runs code from a file, and what does not fit into memory is refused by its header.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.height_table import is_table, read_table, sizes_of

FEWEST = 4  # values along an axis
_MOST_VALUES = 16_000_000
_MOST_BYTES = 400_000_000
# SurfaceTopography's names of formats whose y points upwards, and of those without coordinates.
_RIGHT_HANDED = {"x3p", "sdf", "nc", "xyz", "nmm"}
_ARRAYS = {"npy", "npz", "mat", "h5"}
# TIFF: (SampleFormat, BitsPerSample) that Pillow reads as they are.
_PILLOW = {(1, 8), (1, 16), (2, 16), (2, 32), (3, 32)}
_BITS, _PHOTOMETRIC, _SAMPLES, _SAMPLE_FORMAT, _NODATA = 258, 262, 277, 339, 42113


@dataclass(frozen=True)
class Raw:
    """Values (along X, along Y) as a file has them; its sizes where it states them.

    Attributes
    ----------
    values
        Rows and columns of numbers.
    spacing_mm
        Between two values along X and along Y.
    unit_mm
        Height of one unit of the values.
    """

    values: NDArray[Any]
    spacing_mm: tuple[float, float] | None = None
    unit_mm: float | None = None


def read_raw(file: Path) -> Raw:
    """Return the heights of a file.

    Raises
    ------
    StudyError
        There is none, it is too large, or cannot be read.
    """
    if not file.is_file():
        raise StudyError(f"stimulus.file = {file}: there is no such file")
    if file.stat().st_size > _MOST_BYTES:
        raise StudyError(
            f"stimulus.file = {file} has {file.stat().st_size:,} bytes but may have at most "
            f"{_MOST_BYTES:,}"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a library's remarks on a format's details
            raw = _READERS.get(file.suffix.lower(), _instrument)(file)
    except StudyError:
        raise
    except Exception as error:  # each library has its own for what it cannot parse
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise StudyError(f"stimulus.file = {file} cannot be read: {reason}") from None
    if raw.values.ndim != 2 or raw.values.dtype.kind not in "iuf":
        what = f"{raw.values.ndim} dimensions of {raw.values.dtype}"
        raise StudyError(
            f"stimulus.file = {file} holds {what} but must hold real numbers in rows and columns"
        )
    _check_count(raw.values.shape, file)
    return raw


def _check_count(shape: tuple[int, ...], file: Path) -> None:
    if np.prod([float(n) for n in shape]) > _MOST_VALUES:
        size = " x ".join(map(str, shape))
        raise StudyError(
            f"stimulus.file = {file} holds {size} heights but may hold at most "
            f"{_MOST_VALUES:,}: crop it or thin it out"
        )


def _array(file: Path) -> Raw:
    return Raw(np.lib.format.open_memmap(file, mode="r"))


def _table(file: Path) -> Raw:
    table = read_table(file, lambda shape: _check_count(shape, file))
    return Raw(table.values, *sizes_of(table.header, table.values.shape, file))


def _dat(file: Path) -> Raw:
    return _table(file) if is_table(file) else _instrument(file)


# --- images ----------------------------------------------------------------------------------


def _image(file: Path) -> Raw:
    with Image.open(file) as image:
        _check_gray(image, file)
        raw_mode = str(image.tile[0][3]) if image.tile else ""
        if raw_mode in ("L;2", "L;4"):
            raise StudyError(
                f"stimulus.file = {file} has {raw_mode[-1]} bits a value but must have 8 or 16"
            )
        return Raw(np.asarray(ImageOps.exif_transpose(image)))


def _tiff(file: Path) -> Raw:
    """Read by Pillow, with any compression, what it reads as it is; else by tifffile."""
    try:
        with Image.open(file) as image:
            tags = image.tag_v2  # type: ignore[attr-defined]
            kind = tags.get(_SAMPLE_FORMAT, (1,))[0], tags.get(_BITS, (1,))[0]
            several = tags.get(_SAMPLES, 1) > 1 or tags.get(_PHOTOMETRIC) != 1
            if several or kind in _PILLOW:
                _check_gray(image, file)
                if tags.get(_PHOTOMETRIC) != 1:
                    _refuse_white(file)
                image.load()  # some versions of Pillow turn it as its Orientation says, then
                upright = np.asarray(ImageOps.exif_transpose(image))
                return Raw(_without_holes(upright, tags.get(_NODATA)))
    except UnidentifiedImageError:
        pass
    return _tiff_of_other_numbers(file)


def _tiff_of_other_numbers(file: Path) -> Raw:
    with _optional("tifffile", file, "TIFF files of such numbers").TiffFile(file) as tiff:
        if len(tiff.pages) > 1:
            _refuse_several(file, len(tiff.pages))
        page = tiff.pages[0]
        if page.samplesperpixel > 1 or page.photometric not in (0, 1):
            raise StudyError(f"stimulus.file = {file} is a coloured image but must be gray")
        if page.photometric == 0:
            _refuse_white(file)
        orientation = page.tags["Orientation"].value if "Orientation" in page.tags else 1
        if orientation != 1:
            raise StudyError(
                f"stimulus.file = {file} lies turned or mirrored (Orientation {orientation}): save "
                "it upright"
            )
        _check_count(page.shape, file)
        if page.compression != 1 and sum(page.databytecounts) > 1.1 * page.nbytes + 1000:
            raise StudyError(f"stimulus.file = {file} cannot be read: it is damaged")
        return Raw(_without_holes(page.asarray(), page.tags.valueof(_NODATA)))


def _check_gray(image: Image.Image, file: Path) -> None:
    if image.mode not in ("L", "F", "I") and not image.mode.startswith("I;16"):
        raise StudyError(
            f"stimulus.file = {file} is an image of mode {image.mode} but must be gray, "
            "without colours, palette or transparency"
        )
    if getattr(image, "n_frames", 1) > 1:
        _refuse_several(file, image.n_frames)  # type: ignore[attr-defined]
    _check_count(image.size, file)


def _refuse_several(file: Path, count: int) -> None:
    raise StudyError(f"stimulus.file = {file} holds {count} images but must be one")


def _refuse_white(file: Path) -> None:
    raise StudyError(
        f"stimulus.file = {file} counts its gray values from white (WhiteIsZero): save it with "
        "black as 0"
    )


def _without_holes(values: NDArray[Any], marker: object) -> NDArray[Any]:
    """Return values with NaN where they equal the marker that a GeoTIFF states."""
    try:
        missing = values == float(str(marker).strip("\0 "))
    except ValueError:
        return values
    return np.where(missing, np.nan, values) if missing.any() else values


# --- instruments -----------------------------------------------------------------------------


def _instrument(file: Path) -> Raw:
    """Read a format of SurfaceTopography, which knows sizes before it reads heights."""
    library = _optional("SurfaceTopography.IO", file, f'files that end in "{file.suffix}"')
    convert = importlib.import_module("SurfaceTopography.Support.UnitConversion")
    with library.open_topography(str(file)) as reader:
        if reader.format() == "asc":
            if not is_table(file):
                raise StudyError(
                    f"stimulus.file = {file} cannot be read: it has less than {FEWEST} columns"
                )
            return _table(file)
        channel = _only_map(reader, file) if reader.format() in _ARRAYS else reader.default_channel
        if channel.dim != 2:
            raise StudyError(f"stimulus.file = {file} holds a profile but must hold a surface")
        _check_count(tuple(channel.nb_grid_pts), file)
        stated = channel.physical_sizes is not None
        found = channel.topography(physical_sizes=None if stated else channel.nb_grid_pts)
        values = np.ma.filled(np.ma.asarray(found.heights(), dtype=np.float64), np.nan)
        if reader.format() == "nc":
            values = _by_coordinates(values, file)
        elif reader.format() not in _RIGHT_HANDED | _ARRAYS:
            values = values[:, ::-1]
        if found.unit is None:
            return Raw(values)
        unit_mm = float(convert.get_unit_conversion_factor(found.unit, "mm"))
        if not stated:
            return Raw(values, None, unit_mm)
        x, y = np.array(channel.physical_sizes, dtype=float) * unit_mm / values.shape
        values = values[:: -1 if x < 0 else 1, :: -1 if y < 0 else 1]
        return Raw(values, (abs(x), abs(y)), unit_mm)


def _by_coordinates(values: NDArray[Any], file: Path) -> NDArray[Any]:
    """Return heights of a NetCDF file along increasing x and y; the library takes them as such."""
    with scipy.io.netcdf_file(file, mmap=False) as stream:
        if stream.variables["heights"].dimensions == ("y", "x"):
            values = values.T
        for axis, name in enumerate("xy"):
            places = stream.variables[name][:] if name in stream.variables else np.arange(2)
            if places[-1] < places[0]:
                values = np.flip(values, axis)
    return values


def _only_map(reader: Any, file: Path) -> Any:
    """Return the one channel of a file of arrays that can be a map."""
    maps = [channel for channel in reader.channels if min(channel.nb_grid_pts) >= FEWEST]
    if len(maps) != 1:
        names = ", ".join(channel.name for channel in maps) or "none"
        raise StudyError(
            f"stimulus.file = {file} must hold one array of {FEWEST} x {FEWEST} numbers or more "
            f"but holds {len(maps)} ({names}): save that of the heights by itself"
        )
    return maps[0]


def _optional(name: str, file: Path, what: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise StudyError(
            f"stimulus.file = {file}: {what} are read by {package}: pip install {package}"
        ) from None


_READERS: dict[str, Callable[[Path], Raw]] = {
    ".npy": _array,
    **dict.fromkeys((".csv", ".txt", ".asc"), _table),
    ".dat": _dat,
    ".png": _image,
    **dict.fromkeys((".tif", ".tiff"), _tiff),
}
