"""Reads measured heights: arrays, tables, gray images and instruments' files.

Nothing here runs code from a file, and what does not fit into memory is refused by its header.
"""

from __future__ import annotations

import importlib
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array
from tactile_fem.study import Surface

_MOST_VALUES = 16_000_000
_MOST_BYTES = 400_000_000
_FEWEST = 4  # values along an axis


@dataclass(frozen=True)
class Topography:
    """Heights over a plane.

    Attributes
    ----------
    heights_mm
        (nx, ny), upwards.
    spacing_mm
        Between values along X and along Y.
    """

    heights_mm: Array
    spacing_mm: tuple[float, float]


@dataclass(frozen=True)
class _Raw:
    """Values as a file has them; its spacing in mm and its unit in mm where it states them."""

    values: NDArray[Any]
    spacing_mm: tuple[float, float] | None = None
    unit_mm: float | None = None


def read_topography(surface: Surface) -> Topography:
    """Return the heights that a study names, cropped.

    Raises
    ------
    StudyError
        The file cannot be read, is too large, has missing or infinite heights, or lacks a spacing
        or unit that the study does not give either; the crop lies outside it.
    """
    file = surface.file
    raw = _read(file)
    _check_values(raw.values, file)
    spacing = (surface.spacing_mm,) * 2 if surface.spacing_mm else raw.spacing_mm
    unit = surface.unit_mm or raw.unit_mm
    for key, value in {"spacing_mm": spacing, "unit_mm": unit}.items():
        if value is None:
            raise StudyError(f"stimulus.{key} must be given, because {file} does not state it")
    assert spacing and unit
    values = _cropped(raw.values, spacing, surface.crop_mm)
    heights = unit * np.asarray(values, dtype=np.float64)
    missing = ~np.isfinite(heights)
    if missing.any():
        row, column = np.argwhere(missing)[0]
        raise StudyError(
            f"stimulus.file = {file} has {missing.sum()} missing or infinite heights, the first in "
            f"row {row}, column {column}: fill them in, or crop them away with stimulus.crop_mm"
        )
    return Topography(heights, spacing)


def _cropped(
    values: NDArray[Any],
    spacing: tuple[float, float],
    crop_mm: tuple[float, float, float, float] | None,
) -> NDArray[Any]:
    if crop_mm is not None:
        low, high = np.reshape(crop_mm, (2, 2))
        lengths = (np.array(values.shape) - 1) * spacing
        if np.any(high > lengths + 1e-9) or np.any(low >= high):
            raise StudyError(
                f"stimulus.crop_mm = {list(crop_mm)} must be least X and Y and largest X and Y "
                f"within the file's {lengths[0]:.4g} mm x {lengths[1]:.4g} mm"
            )
        first, last = (np.rint(end / spacing).astype(int) for end in (low, high))
        values = values[first[0] : last[0] + 1, first[1] : last[1] + 1]
    if min(values.shape) < _FEWEST:
        rows, columns = values.shape
        raise StudyError(
            f"stimulus: {rows} x {columns} heights make no surface; {_FEWEST} each way are needed"
        )
    return values


def _check_values(values: NDArray[Any], file: Path) -> None:
    if values.ndim != 2 or values.dtype.kind not in "iuf":
        what = f"{values.ndim} dimensions of {values.dtype}"
        raise StudyError(
            f"stimulus.file = {file} holds {what} but must hold real numbers in rows and columns"
        )
    _check_count(values.shape, file)


def _check_count(shape: tuple[int, ...], file: Path) -> None:
    if np.prod([float(n) for n in shape]) > _MOST_VALUES:
        size = " x ".join(map(str, shape))
        raise StudyError(
            f"stimulus.file = {file} holds {size} heights but may hold at most "
            f"{_MOST_VALUES:,}: crop it or thin it out"
        )


# --- formats -------------------------------------------------------------------------------------


def _read(file: Path) -> _Raw:
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
            return _READERS.get(file.suffix.lower(), _instrument)(file)
    except StudyError:
        raise
    except Exception as error:  # each library has its own for what it cannot parse
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise StudyError(f"stimulus.file = {file} cannot be read: {reason}") from None


def _array(file: Path) -> _Raw:
    return _Raw(np.lib.format.open_memmap(file, mode="r"))


def _table(file: Path) -> _Raw:
    with file.open(encoding="utf-8-sig") as stream:
        first = next((line for line in stream if line.strip() and line[0] != "#"), "")
        comma = next((mark for mark in ",;" if mark in first), None)
        _check_count((len(re.split(r"[,;\s]+", first)), 1), file)
        stream.seek(0)
        return _Raw(np.loadtxt(stream, delimiter=comma, ndmin=2, dtype=np.float64))


def _image(file: Path) -> _Raw:
    with Image.open(file) as image:
        if image.mode not in ("L", "F", "I") and not image.mode.startswith("I;16"):
            raise StudyError(
                f"stimulus.file = {file} is an image of mode {image.mode} but must be gray, "
                "without colours, palette or transparency"
            )
        if getattr(image, "n_frames", 1) > 1:
            raise StudyError(
                f"stimulus.file = {file} holds {image.n_frames} images but must be one"
            )
        _check_count(image.size, file)
        return _Raw(np.asarray(image))


def _instrument(file: Path) -> _Raw:
    """Read a format of SurfaceTopography, which tells sizes before it reads heights."""
    try:
        library = importlib.import_module("SurfaceTopography.IO")
    except ImportError:
        raise StudyError(
            f'stimulus.file = {file}: files that end in "{file.suffix}" are read by '
            "SurfaceTopography: pip install SurfaceTopography"
        ) from None
    reader = library.open_topography(str(file))
    channel = reader.default_channel
    if channel.dim != 2:
        raise StudyError(f"stimulus.file = {file} holds a profile but must hold a surface")
    _check_count(tuple(channel.nb_grid_pts), file)
    found = channel.topography()
    if found.unit is None:
        return _Raw(np.ma.filled(found.heights(), np.nan))
    found = found.to_unit("mm")
    return _Raw(np.ma.filled(found.heights(), np.nan), tuple(found.pixel_size), 1.0)


_READERS: dict[str, Callable[[Path], _Raw]] = {
    ".npy": _array,
    **dict.fromkeys((".csv", ".txt", ".asc"), _table),
    **dict.fromkeys((".png", ".tif", ".tiff"), _image),
}
