"""Reads measured heights: arrays, tables, gray images and instruments' files."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.height_formats import FEWEST, Raw, read_raw
from tactile_fem.stimulus.height_table import header_library
from tactile_fem.stimulus.plausible import check_sizes, check_values

if TYPE_CHECKING:
    from tactile_fem.stimulus.surface import Surface

logger = logging.getLogger(__name__)

# A size that the study gives beside the file's is told if it differs by more than this share.
_SAME = 0.01
_TEXT = {".csv", ".txt", ".asc", ".dat"}


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


def read_topography(surface: Surface) -> Topography:
    """Return the heights that a study names, cropped.

    Raises
    ------
    StudyError
        The file cannot be read, is too large, has missing or infinite heights, lacks a spacing or
        unit that the study does not give either, or no finger can touch a surface of such sizes;
        the crop lies outside it.
    """
    file = surface.file
    raw = read_raw(file)
    spacing = (surface.spacing_mm,) * 2 if surface.spacing_mm else raw.spacing_mm
    unit = surface.unit_mm or raw.unit_mm
    for key, value in {"spacing_mm": spacing, "unit_mm": unit}.items():
        if value is None:
            raise StudyError(
                f"stimulus.{key} must be given: {file} states none that is known{_hint(file)}"
            )
    assert spacing and unit
    _tell_differences(surface, raw)
    values = _cropped(raw.values, spacing, surface.crop_mm)
    check_sizes(spacing, values.shape, file)
    missing = ~np.isfinite(values)
    if missing.any():
        row, column = np.argwhere(missing)[0]
        raise StudyError(
            f"stimulus.file = {file} has {missing.sum()} missing or infinite heights, the first in "
            f"row {row}, column {column}: fill them in, or crop them away with stimulus.crop_mm"
        )
    check_values(values, raw.values.dtype, file)
    return Topography(unit * np.asarray(values, dtype=np.float64), spacing)


def _hint(file: Path) -> str:
    """Return what would read the sizes in the header of a text file, if it is not there."""
    if file.suffix.lower() not in _TEXT or header_library():
        return ""
    return " (a header is read by SurfaceTopography: pip install SurfaceTopography)"


def _tell_differences(surface: Surface, raw: Raw) -> None:
    """Warn of sizes that replace different ones of the file."""
    stated = {"spacing_mm": raw.spacing_mm, "unit_mm": raw.unit_mm}
    for key, of_file in stated.items():
        given = getattr(surface, key)
        if given and of_file and not np.allclose(given, of_file, rtol=_SAME, atol=0):
            numbers = " x ".join(f"{number:.4g}" for number in np.atleast_1d(of_file))
            logger.warning(
                "stimulus.%s = %g replaces the %s that %s states", key, given, numbers, surface.file
            )


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
    if min(values.shape) < FEWEST:
        rows, columns = values.shape
        raise StudyError(
            f"stimulus: {rows} x {columns} heights make no surface; {FEWEST} each way are needed"
        )
    return values
