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
from tactile_fem.runtime.number_table import UnusableError, check_count, is_table, read_table
from tactile_fem.stimulus.height_table import sizes_of

MIN_VALUES = 4  # along an axis
_MAX_BYTES = 400_000_000
# SurfaceTopography's names of formats whose y points upwards, and of those without coordinates.
_RIGHT_HANDED = {"x3p", "sdf", "nc", "xyz", "nmm"}
_ARRAYS = {"npy", "npz", "mat", "h5"}
# TIFF: (SampleFormat, BitsPerSample) that Pillow reads as they are.
_PILLOW = {(1, 8), (1, 16), (2, 16), (2, 32), (3, 32)}
_BITS, _PHOTOMETRIC, _SAMPLES, _SAMPLE_FORMAT, _NODATA = 258, 262, 277, 339, 42113
_FROM_WHITE = "counts its gray values from white (WhiteIsZero): save it with black as 0"


@dataclass(frozen=True)
class Raw:
    """Values (along X, along Y) as a file has them, and in mm, where it states them, sizes.

    They are the spacing along X and along Y, and the height of one unit of the values.
    """

    values: NDArray[Any]
    spacing_mm: tuple[float, float] | None = None
    unit_mm: float | None = None


def read_raw(file: Path, key: str = "stimulus.file") -> Raw:
    """Return the heights of a file, which a study names with `key`.

    Raises
    ------
    StudyError
        There is none, it is too large, or cannot be read.
    """
    start = f"{key} = {file}"
    if not file.is_file():
        raise StudyError(f"{start}: there is no such file")
    try:
        if (size := file.stat().st_size) > _MAX_BYTES:
            raise UnusableError(f"has {size:,} bytes but may have at most {_MAX_BYTES:,}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a library's remarks on a format's details
            raw = _READERS.get(file.suffix.lower(), _instrument)(file)
        if raw.values.ndim != 2 or raw.values.dtype.kind not in "iuf":
            what = f"{raw.values.ndim} dimensions of {raw.values.dtype}"
            raise UnusableError(f"holds {what} but must hold real numbers in rows and columns")
        check_count(raw.values.shape)
    except StudyError:
        raise
    except UnusableError as error:
        raise StudyError(f"{start} {error}") from None
    except Exception as error:  # each library has its own for what it cannot parse
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise StudyError(f"{start} cannot be read: {reason}") from None
    return raw


def _array(file: Path) -> Raw:
    return Raw(np.lib.format.open_memmap(file, mode="r"))


def _table(file: Path) -> Raw:
    values, header = read_table(file, f"stimulus.file = {file}")
    return Raw(values, *sizes_of(header, values.shape, file))


def _dat(file: Path) -> Raw:
    return _table(file) if is_table(file) else _instrument(file)


# --- images ----------------------------------------------------------------------------------


def _image(file: Path) -> Raw:
    with Image.open(file) as image:
        _check_gray(image)
        raw_mode = str(image.tile[0][3]) if image.tile else ""
        if raw_mode in ("L;2", "L;4"):
            raise UnusableError(f"has {raw_mode[-1]} bits a value but must have 8 or 16")
        return Raw(np.asarray(ImageOps.exif_transpose(image)))


def _tiff(file: Path) -> Raw:
    """Read by Pillow, with any compression, what it reads as it is; else by tifffile."""
    try:
        with Image.open(file) as image:
            tags = image.tag_v2  # type: ignore[attr-defined]
            kind = tags.get(_SAMPLE_FORMAT, (1,))[0], tags.get(_BITS, (1,))[0]
            several = tags.get(_SAMPLES, 1) > 1 or tags.get(_PHOTOMETRIC) != 1
            if several or kind in _PILLOW:
                _check_gray(image)
                if tags.get(_PHOTOMETRIC) != 1:
                    raise UnusableError(_FROM_WHITE)
                image.load()  # some versions of Pillow turn it as its Orientation says, then
                upright = np.asarray(ImageOps.exif_transpose(image))
                return Raw(_without_marker(upright, tags.get(_NODATA)))
    except UnidentifiedImageError:
        pass
    return _tiff_of_other_numbers(file)


def _tiff_of_other_numbers(file: Path) -> Raw:
    with _optional("tifffile", "TIFF files of such numbers").TiffFile(file) as tiff:
        _check_single(len(tiff.pages))
        page = tiff.pages[0]
        if page.samplesperpixel > 1 or page.photometric not in (0, 1):
            raise UnusableError("is a coloured image but must be gray")
        if page.photometric == 0:
            raise UnusableError(_FROM_WHITE)
        orientation = page.tags["Orientation"].value if "Orientation" in page.tags else 1
        if orientation != 1:
            raise UnusableError(
                f"lies turned or mirrored (Orientation {orientation}): save it upright"
            )
        check_count(page.shape)
        if page.compression != 1 and sum(page.databytecounts) > 1.1 * page.nbytes + 1000:
            raise UnusableError("cannot be read: it is damaged")
        return Raw(_without_marker(page.asarray(), page.tags.valueof(_NODATA)))


def _check_gray(image: Image.Image) -> None:
    is_gray = image.mode in ("L", "F", "I") or image.mode.startswith("I;16")
    if not is_gray or "transparency" in image.info:
        raise UnusableError(
            f"is an image of mode {image.mode} but must be gray, without colours, palette or "
            "transparency"
        )
    _check_single(getattr(image, "n_frames", 1))
    check_count(image.size)


def _check_single(images: int) -> None:
    if images > 1:
        raise UnusableError(f"holds {images} images but must be one")


def _without_marker(values: NDArray[Any], marker: object) -> NDArray[Any]:
    """Return values with NaN where they equal the marker that a file states."""
    try:
        missing = values == float(str(marker).strip("\0 "))
    except ValueError:
        return values
    return np.where(missing, np.nan, values) if missing.any() else values


# --- instruments -----------------------------------------------------------------------------


def _instrument(file: Path) -> Raw:
    """Read a format of SurfaceTopography, which knows sizes before it reads heights."""
    library = _optional("SurfaceTopography.IO", f'files that end in "{file.suffix}"')
    convert = importlib.import_module("SurfaceTopography.Support.UnitConversion")
    with library.open_topography(str(file)) as reader:
        if reader.format() == "asc":
            if not is_table(file):
                raise UnusableError(f"cannot be read: it has less than {MIN_VALUES} columns")
            return _table(file)
        channel = _only_map(reader) if reader.format() in _ARRAYS else reader.default_channel
        if channel.dim != 2:
            raise UnusableError("holds a profile but must hold a surface")
        check_count(tuple(channel.nb_grid_pts))
        has_sizes = channel.physical_sizes is not None
        found = channel.topography(physical_sizes=None if has_sizes else channel.nb_grid_pts)
        values = np.ma.filled(np.ma.asarray(found.heights(), dtype=np.float64), np.nan)
        if reader.format() == "h5":
            values = _without_marker(values, _fill_value(file, channel.name))
        elif reader.format() == "nc":
            values = _by_coordinates(values, file)
        elif reader.format() not in _RIGHT_HANDED | _ARRAYS:
            values = values[:, ::-1]
        if found.unit is None:
            return Raw(values)
        unit_mm = float(convert.get_unit_conversion_factor(found.unit, "mm"))
        if not has_sizes:
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


def _fill_value(file: Path, name: str) -> float:
    """Return what marks missing values of an array of HDF5, as NetCDF and xarray write it."""
    with importlib.import_module("h5py").File(file) as stream:
        found = stream[name].attrs
        return float(np.ravel(found.get("_FillValue", found.get("missing_value", np.nan)))[0])


def _only_map(reader: Any) -> Any:
    """Return the one channel of a file of arrays that can be a map."""
    maps = [channel for channel in reader.channels if min(channel.nb_grid_pts) >= MIN_VALUES]
    if len(maps) != 1:
        names = ", ".join(channel.name for channel in maps) or "none"
        raise UnusableError(
            f"must hold one array of {MIN_VALUES} x {MIN_VALUES} numbers or more but holds "
            f"{len(maps)} ({names}): save that of the heights by itself"
        )
    return maps[0]


def _optional(name: str, what: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise UnusableError(f"needs {package}, which reads {what}: pip install {package}") from None


_READERS: dict[str, Callable[[Path], Raw]] = {
    ".npy": _array,
    **dict.fromkeys((".csv", ".txt", ".asc"), _table),
    ".dat": _dat,
    ".png": _image,
    **dict.fromkeys((".tif", ".tiff"), _tiff),
}
