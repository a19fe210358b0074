"""Whether measured heights can be those of something that a finger touches."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array

logger = logging.getLogger(__name__)

# Lengths in mm: more is refused, and a warning beyond the second number, where there is one.
_SPACING = 10.0, 2.0
_EXTENT = 1000.0
_RELIEF = 20.0, 5.0
# Below these lengths there is a warning.
_SMALL_EXTENT, _SMALL_RELIEF = 1.0, 1e-5
# Numbers that programs write where nothing was measured.
_MARKERS = {
    *(sign * number for sign in (-1, 1) for number in (999, 9999, 99999, 999999, 1e10)),
    *(-32768, -32767, -(2**31), 1 - 2**31),
}
_HUGE = 1e30
# A marker is this share of the range of all other heights away from them.
_APART = 0.25
# Other values may mark missing heights if they are this far away and no more frequent.
_FAR, _FAR_OF_EXTREMES, _RARE, _RARE_EXTREMES = 10.0, 1.0, 0.05, 0.2


def check_values(values: NDArray[np.generic], kind: np.dtype[Any], file: Path) -> None:
    """Refuse values that certainly mark missing heights; warn of those that may.

    Parameters
    ----------
    values
        Finite numbers as the file has them.
    kind
        Type of the numbers in the file: the ends of a range of integers may be markers.
    file
        For messages.

    Raises
    ------
    StudyError
        Names the value, how often and where it is, and what helps.
    """
    ends = {0.0}
    if kind.kind in "iu":
        ends |= {float(np.iinfo(kind).min), float(np.iinfo(kind).max)}
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
        if abs(value) >= _HUGE or (value in _MARKERS and spread > 0 and gap > _APART * spread):
            raise StudyError(
                f"{what}: it marks missing heights; fill them in, or crop them away with "
                "stimulus.crop_mm"
            )
        is_far = gap > _FAR * spread and share < _RARE
        is_end = value in ends and gap > _FAR_OF_EXTREMES * spread and share < _RARE_EXTREMES
        if spread > 0 and (is_far or is_end):
            logger.warning("%s: do they mark missing heights?", what)


def check_sizes(spacing_mm: tuple[float, float], shape: tuple[int, int], file: Path) -> None:
    """Refuse a map that is too coarse or large for a finger; warn if it may be.

    Raises
    ------
    StudyError
        Names the length and what is allowed.
    """
    extent = [step * (n - 1) for step, n in zip(spacing_mm, shape, strict=True)]
    step, size = max(spacing_mm), " x ".join(f"{length:.4g}" for length in extent)
    start = f"stimulus.spacing_mm = {step:.4g} ({file})"
    if step > _SPACING[0]:
        raise StudyError(
            f"{start} must not exceed {_SPACING[0]:g}, the width of the contact: is it in mm?"
        )
    if max(extent) > _EXTENT:
        raise StudyError(
            f"{start} makes a surface of {size} mm, but its longest side may have at most "
            f"{_EXTENT:g} mm: is the spacing in mm? A part of it is taken by stimulus.crop_mm"
        )
    if step > _SPACING[1]:
        logger.warning("%s is coarse for a finger: is it in mm?", start)
    if max(extent) < _SMALL_EXTENT:
        logger.warning(
            "%s makes a surface of %s mm, repeated without end: is the spacing in mm?", start, size
        )


def check_relief(heights_mm: Array, file: Path) -> None:
    """Refuse levelled heights that differ by more than a finger can follow; warn if they may.

    Raises
    ------
    StudyError
        Names the difference and what is allowed.
    """
    relief = float(np.ptp(heights_mm))
    what = (
        f"stimulus.unit_mm: the heights in {file} differ by {relief:.3g} mm after levelling, rms "
        f"{float(np.std(heights_mm)):.3g} mm"
    )
    if relief > _RELIEF[0]:
        raise StudyError(
            f"{what}, but at most {_RELIEF[0]:g} mm are allowed: is the unit right, and are "
            "missing heights filled in?"
        )
    if relief > _RELIEF[1]:
        logger.warning("%s: more than a finger can follow; is the unit right?", what)
    if relief < _SMALL_RELIEF:
        logger.warning("%s: less than a finger can feel; is the unit right?", what)
