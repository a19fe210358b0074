"""Measured heights: read, cropped, and checked whether a finger can touch such a surface."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.heights import LEAST_HEIGHTS, read_raw

logger = logging.getLogger(__name__)

# A size that the study gives beside the file's is reported if it differs by more than this share.
_SAME_SIZE = 0.01
# Lengths in mm beyond which there is a warning, and beyond which they are refused.
_COARSE_MM, _MAX_SPACING_MM = 2.0, 10.0
_SMALL_MM, _MAX_EXTENT_MM = 1.0, 1000.0
_FLAT_MM, _ROUGH_MM, _MAX_RELIEF_MM = 1e-5, 5.0, 20.0
# Numbers that programs write where nothing was measured.
_MARKERS = {
    *(sign * number for sign in (-1, 1) for number in (999, 9999, 99999, 999999, 1e10)),
    *(-32768, -32767, -(2**31), 1 - 2**31),
}
_MIN_MARKER = 1e30  # what is larger is always one
# Gap between a marker and the heights, as a share of their range.
_MARKER_GAP = 0.25
# An extreme value may be a marker if its gap is larger, and its share of the points smaller than
# these: any value, and zero or an end of the range of integers.
_ANY_GAP, _ANY_SHARE = 10.0, 0.05
_END_GAP, _END_SHARE = 1.0, 0.2


@dataclass(frozen=True)
class Topography:
    """Heights (nx, ny) in mm, upwards, and their spacing along X and along Y in mm."""

    heights_mm: Array
    spacing_mm: tuple[float, float]


def read_topography(
    file: Path,
    spacing_mm: float | None = None,
    unit_mm: float | None = None,
    crop_mm: tuple[float, float, float, float] | None = None,
) -> Topography:
    """Return the heights in a file, cropped.

    Spacing between two values and height of one unit are by default as the file states; the crop is
    least X and Y and largest X and Y of the part, by default all of it.

    Raises
    ------
    StudyError
        The file cannot be read, is too large, has missing or infinite heights, states no spacing or
        unit that is not given either, or no finger can touch a surface of such sizes; the crop lies
        outside it.
    """
    raw = read_raw(file)
    spacing = raw.spacing_mm if spacing_mm is None else (spacing_mm, spacing_mm)
    unit = raw.unit_mm if unit_mm is None else unit_mm
    if spacing is None or unit is None:
        raise StudyError(
            f"stimulus.{'spacing_mm' if spacing is None else 'unit_mm'} must be given: {file} "
            f"states none that is known{raw.hint}"
        )
    given = {"spacing_mm": (spacing_mm, raw.spacing_mm), "unit_mm": (unit_mm, raw.unit_mm)}
    for key, (number, stated) in given.items():
        if number and stated and not np.allclose(number, stated, rtol=_SAME_SIZE, atol=0):
            others = " x ".join(f"{one:.4g}" for one in np.atleast_1d(stated))
            told = "stimulus.%s = %g replaces the %s that %s states"
            logger.warning(told, key, number, others, file)
    values = _cropped(raw.values, spacing, crop_mm)
    _check_sizes(spacing, values.shape, file)
    missing = ~np.isfinite(values)
    if missing.any():
        row, column = np.argwhere(missing)[0]
        raise StudyError(
            f"stimulus.file = {file} has {missing.sum()} missing or infinite heights, the first in "
            f"row {row}, column {column}: fill them in, or crop them away with stimulus.crop_mm"
        )
    _check_values(values, file)
    return Topography(unit * np.asarray(values, dtype=np.float64), spacing)


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
    if min(values.shape) < LEAST_HEIGHTS:
        rows, columns = values.shape
        raise StudyError(
            f"stimulus: {rows} x {columns} heights make no surface; {LEAST_HEIGHTS} each way are "
            "needed"
        )
    return values


def _check_sizes(spacing_mm: tuple[float, float], shape: tuple[int, int], file: Path) -> None:
    """Refuse a map that is too coarse or large for a finger; warn if it may be."""
    extent = [step * (n - 1) for step, n in zip(spacing_mm, shape, strict=True)]
    step, size = max(spacing_mm), " x ".join(f"{length:.4g}" for length in extent)
    start = f"stimulus.spacing_mm = {step:.4g} ({file})"
    if step > _MAX_SPACING_MM:
        raise StudyError(
            f"{start} must not exceed {_MAX_SPACING_MM:g}, the width of the contact: is it in mm?"
        )
    if max(extent) > _MAX_EXTENT_MM:
        raise StudyError(
            f"{start} makes a surface of {size} mm, but its longest side may have at most "
            f"{_MAX_EXTENT_MM:g} mm: is the spacing in mm? A part of it is taken by "
            "stimulus.crop_mm"
        )
    if step > _COARSE_MM:
        logger.warning("%s is coarse for a finger: is it in mm?", start)
    if max(extent) < _SMALL_MM:
        logger.warning(
            "%s makes a surface of %s mm, repeated without end: is the spacing in mm?", start, size
        )


def _check_values(values: NDArray[Any], file: Path) -> None:
    """Refuse values of a file that certainly mark missing heights; warn of those that may."""
    ends = {0.0}
    if values.dtype.kind in "iu":
        ends |= {float(np.iinfo(values.dtype).min), float(np.iinfo(values.dtype).max)}
    for value in (float(values.min()), float(values.max())):
        at = values == value
        others = values[~at]
        if not others.size:
            return
        low, high, share = float(others.min()), float(others.max()), float(at.mean())
        gap, spread = max(low - value, value - high), high - low
        row, column = np.argwhere(at)[0]
        what = (
            f"stimulus.file = {file} has the height {value:g} at {at.sum()} of its points, the "
            f"first in row {row}, column {column}, far from all others ({low:g} to {high:g})"
        )
        is_known = value in _MARKERS and spread > 0 and gap > _MARKER_GAP * spread
        if abs(value) >= _MIN_MARKER or is_known:
            raise StudyError(
                f"{what}: it marks missing heights; fill them in, or crop them away with "
                "stimulus.crop_mm"
            )
        is_far = gap > _ANY_GAP * spread and share < _ANY_SHARE
        is_end = value in ends and gap > _END_GAP * spread and share < _END_SHARE
        if spread > 0 and (is_far or is_end):
            logger.warning("%s: do they mark missing heights?", what)


def check_relief(heights_mm: Array, file: Path) -> None:
    """Refuse levelled heights that differ by more than a finger can follow; warn if they may."""
    relief = float(np.ptp(heights_mm))
    what = (
        f"stimulus.unit_mm: the heights in {file} differ by {relief:.3g} mm after levelling, rms "
        f"{float(np.std(heights_mm)):.3g} mm"
    )
    if relief > _MAX_RELIEF_MM:
        raise StudyError(
            f"{what}, but at most {_MAX_RELIEF_MM:g} mm are allowed: is the unit right, and are "
            "missing heights filled in?"
        )
    if relief > _ROUGH_MM:
        logger.warning("%s: more than a finger can follow; is the unit right?", what)
    if relief < _FLAT_MM:
        logger.warning("%s: less than a finger can feel; is the unit right?", what)
