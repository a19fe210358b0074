"""Instruments' formats of measured heights, and how a map of each lies under the finger.

Seen from above, with X to the right and Y upwards, no map may become its mirror image:

========================================  ==========================================================
``.npy .npz .mat .h5``, tables, images    first row at the least X, first column at the least Y: the
                                          picture, turned by a quarter; its right is along Y
``x3p sdf nc xyz nmm``                    they state coordinates, or are right-handed by their
                                          standard (ISO 25178-71, -72): their x and y are X and Y
all other instruments' files              a picture, first row on top: its right is X, its top is Y
========================================  ==========================================================
"""

from __future__ import annotations

import importlib
import io
import logging
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.runtime.number_table import UnusableError, check_count, is_table, read_table
from tactile_fem.stimulus import (
    HEIGHT_READERS,
    LEAST_HEIGHTS,
    RawHeights,
    check_gray,
    check_single,
)

logger = logging.getLogger(__name__)

# SurfaceTopography's names of formats whose y points upwards, and of those without coordinates.
_RIGHT_HANDED = {"x3p", "sdf", "nc", "xyz", "nmm"}
_ARRAYS = {"npy", "npz", "mat", "h5"}
# TIFF: (SampleFormat, BitsPerSample) that Pillow reads as they are.
_PILLOW = {(1, 8), (1, 16), (2, 16), (2, 32), (3, 32)}
_BITS, _PHOTOMETRIC, _SAMPLES, _SAMPLE_FORMAT, _NODATA = 258, 262, 277, 339, 42113
_HINT = " (a header is read by SurfaceTopography: pip install SurfaceTopography)"
_FROM_WHITE = "counts its gray values from white (WhiteIsZero): save it with black as 0"


def _table(file: Path) -> RawHeights:
    values, header = read_table(file, f"stimulus.file = {file}")
    try:
        return RawHeights(values, *_stated(header, values.shape, file))
    except ImportError:
        return RawHeights(values, hint=_HINT)


def _stated(
    header: list[str], shape: tuple[int, int], file: Path
) -> tuple[tuple[float, float] | None, float | None]:
    """Return the spacing along rows' X and columns' Y and the unit, mm, that a header states.

    SurfaceTopography knows the headers of Gwyddion, SPIP, Wyko, Nova and Attocube.
    """
    library = importlib.import_module("SurfaceTopography.IO")
    header = [re.sub(r"(\d),(\d)", r"\1.\2", line) for line in header]
    if not any(re.search(r"\d", line) for line in header):
        return None, None
    rows = [" ".join(["1"] * shape[1])] * shape[0]  # their numbers do not matter

    def parsed(*further: str) -> Any:
        text = io.StringIO("\n".join([*header, *further, *rows]))
        with library.open_topography(text, format="asc") as reader:
            return reader.default_channel

    try:
        channel, unit_mm = parsed(), None
        if channel.unit is not None:
            unit_mm = (channel.height_scale_factor or 1.0) * _in_mm(channel.unit)
        elif "xunit" in channel.info["raw_metadata"]:  # it states the unit of lengths only
            channel = parsed("# Value units: mm")
    except importlib.import_module("SurfaceTopography.Exceptions").ReadFileError as error:
        reason = re.sub(r" from the file '.*?'", "", " ".join(str(error).split()))
        logger.warning("The header of %s is not used: %s", file, reason)
        return None, None
    if channel.unit is None or len(channel.physical_sizes or ()) < 2:
        return None, unit_mm
    along_columns, along_rows = np.array(channel.physical_sizes, float) * _in_mm(channel.unit)
    return (float(along_rows / shape[0]), float(along_columns / shape[1])), unit_mm


def _in_mm(unit: str) -> float:
    convert = importlib.import_module("SurfaceTopography.Support.UnitConversion")
    return float(convert.get_unit_conversion_factor(unit, "mm"))


def _dat(file: Path) -> RawHeights:
    return _table(file) if is_table(file) else _instrument(file)


# --- images ----------------------------------------------------------------------------------


def _tiff(file: Path) -> RawHeights:
    """Read by Pillow, with any compression, what it reads as it is; else by tifffile."""
    from PIL import Image, ImageOps, UnidentifiedImageError  # takes a while

    try:
        with Image.open(file) as image:
            tags = image.tag_v2  # type: ignore[attr-defined]
            kind = tags.get(_SAMPLE_FORMAT, (1,))[0], tags.get(_BITS, (1,))[0]
            several = tags.get(_SAMPLES, 1) > 1 or tags.get(_PHOTOMETRIC) != 1
            if several or kind in _PILLOW:
                check_gray(image)
                if tags.get(_PHOTOMETRIC) != 1:
                    raise UnusableError(_FROM_WHITE)
                image.load()  # some versions of Pillow turn it as its Orientation says, then
                upright = np.asarray(ImageOps.exif_transpose(image))
                return RawHeights(_without_marker(upright, tags.get(_NODATA)))
    except UnidentifiedImageError:
        pass
    return _tiff_of_other_numbers(file)


def _tiff_of_other_numbers(file: Path) -> RawHeights:
    with _optional("tifffile", "TIFF files of such numbers").TiffFile(file) as tiff:
        check_single(len(tiff.pages))
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
        return RawHeights(_without_marker(page.asarray(), page.tags.valueof(_NODATA)))


def _without_marker(values: NDArray[Any], marker: object) -> NDArray[Any]:
    """Return values with NaN where they equal the marker that a file states."""
    try:
        missing = values == float(str(marker).strip("\0 "))
    except ValueError:
        return values
    return np.where(missing, np.nan, values) if missing.any() else values


# --- instruments -----------------------------------------------------------------------------


def _instrument(file: Path) -> RawHeights:
    """Read a format of SurfaceTopography, which knows sizes before it reads heights."""
    library = _optional("SurfaceTopography.IO", f'files that end in "{file.suffix}"')
    with library.open_topography(str(file)) as reader:
        if reader.format() == "asc":
            if not is_table(file):
                raise UnusableError(f"cannot be read: it has less than {LEAST_HEIGHTS} columns")
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
            return RawHeights(values)
        unit_mm = _in_mm(found.unit)
        if not has_sizes:
            return RawHeights(values, None, unit_mm)
        x, y = np.array(channel.physical_sizes, dtype=float) * unit_mm / values.shape
        values = values[:: -1 if x < 0 else 1, :: -1 if y < 0 else 1]
        return RawHeights(values, (abs(x), abs(y)), unit_mm)


def _by_coordinates(values: NDArray[Any], file: Path) -> NDArray[Any]:
    """Return heights of a NetCDF file along increasing x and y; the library takes them as such."""
    from scipy.io import netcdf_file  # takes a while

    with netcdf_file(file, mmap=False) as stream:
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
    maps = [channel for channel in reader.channels if min(channel.nb_grid_pts) >= LEAST_HEIGHTS]
    if len(maps) != 1:
        names = ", ".join(channel.name for channel in maps) or "none"
        raise UnusableError(
            f"must hold one array of {LEAST_HEIGHTS} x {LEAST_HEIGHTS} numbers or more but holds "
            f"{len(maps)} ({names}): save that of the heights by itself"
        )
    return maps[0]


def _optional(name: str, what: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise UnusableError(f"needs {package}, which reads {what}: pip install {package}") from None


HEIGHT_READERS |= {
    **dict.fromkeys((".csv", ".txt", ".asc"), _table),
    ".dat": _dat,
    **dict.fromkeys((".tif", ".tiff"), _tiff),
    "": _instrument,
}
