"""A curve as a test rig writes it, force over depth in many rows, averaged into some points."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.calibration.columns import chosen
from tactile_fem.calibration.contact import from_contact
from tactile_fem.errors import StudyError
from tactile_fem.runtime.number_table import UnusableError, read_table

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Points of a curve with more rows, which are averaged; as many steps of the model end at them.
_POINTS = 12
_LEAST_ROWS = 3
# Standard deviation of a point unless it is given: shares of its force and of the largest.
_SHARE, _SHARE_OF_LARGEST = 0.05, 0.01
# Rows in the order of time are behind the deepest one so far by at most this share of the way. A
# hold is less deep than the largest depth by this share of that in which the force is large.
_IN_TIME, _HOLD, _FEW = 0.1, 0.02, 0.05
# Powers of the depth with which the force of a press grows, and more than fingers stand.
_LEAST_POWER, _LARGEST_POWER, _MOST_MM, _MOST_N = 0.6, 6.0, 50.0, 1e3


@dataclass(frozen=True)
class Points:
    """Averages over some of a curve's rows, (n,), and where their standard deviation is from."""

    depth_mm: Array
    force_N: Array
    sd_N: Array
    origin: str


def read_curve(file: Path) -> Array:
    """Return the rows of `curve_of`."""
    return curve_of(file)[0]


def curve_of(file: Path) -> tuple[Array, str]:
    """Return depth since first contact in mm, force in N and, if the file has it, its sd.

    They are (rows, 2) or (rows, 3), with words on columns and contact. Of rows in the order of
    time, they are those until the largest depth. Columns are found by their names, which may state
    units; others are ignored. Two columns without names are depth in mm and force in N.

    Raises
    ------
    StudyError
        The file cannot be read, has no such columns, or two that fit equally, or a unit that is not
        known; or its force does not grow with the depth.
    """
    try:
        values, header = read_table(file, str(file))
    except UnusableError as error:
        raise StudyError(f"{file} {error}.") from None
    rows, columns = chosen(values, header, file)
    rows = _going_in(rows[np.isfinite(rows).all(axis=1)], file)
    rows[:, :2], contact = from_contact(rows[:, 0], rows[:, 1], f"{file} ({columns})")
    if len(rows) >= _LEAST_ROWS:
        points_of(rows[:, 0], rows[:, 1], None, f"{file} ({columns})")
    origin = ", ".join([columns, *contact])
    logger.info("%s: %s", file, origin)
    return rows, origin


def _going_in(rows: Array, file: Path) -> Array:
    """Return the rows until the largest depth, where they follow each other in time."""
    depth, force = rows[:, 0], rows[:, 1]
    if not len(rows):
        return rows
    upper = depth[force >= (force.min() + force.max()) / 2]
    end = int(np.argmax(depth >= depth.max() - _HOLD * np.ptp(upper))) + 1
    if end < _LEAST_ROWS or len(rows) - end <= _FEW * len(rows):
        return rows
    behind = np.maximum.accumulate(depth[:end]) - depth[:end]
    if behind.mean() > _IN_TIME * np.ptp(depth):
        return rows
    logger.info("%s: %d rows after its press are left out", file, len(rows) - end)
    return rows[:end]


def points_of(
    depth_mm: ArrayLike, force_N: ArrayLike, sd_N: ArrayLike | None, where: str
) -> Points:
    """Return averages of a curve (rows,) over intervals of depth, and their standard deviations.

    Rows at a depth of 0 or less are left out. Without `sd_N`, one or (rows,), the standard
    deviation is 5 % of the force and 1 % of the largest, with the error of the average.

    Raises
    ------
    StudyError
        There are too few rows, no force at the largest depth, or one that does not grow as in a
        press from first contact; the message begins with `where`.
    """
    rows = np.column_stack([np.asarray(depth_mm, dtype=float), np.asarray(force_N, dtype=float)])
    used = rows[:, 0] > 0
    depth, force = rows[used].T
    if len(depth) < _LEAST_ROWS:
        raise StudyError(
            f"{where}: the curve has {len(depth)} rows with a depth above 0 but must have "
            f"{_LEAST_ROWS} or more; depths grow into the finger."
        )
    groups = _groups(depth)
    at, mean = np.array([[depth[group].mean(), force[group].mean()] for group in groups]).T
    if mean[-1] <= 0:
        raise StudyError(
            f"{where}: the force at the largest depth is {mean[-1]:.3g} N but must be above 0, as "
            "the finger pushes the indenter back."
        )
    _check_press(at, mean, where)
    if sd_N is None:
        error = np.array([_error_of_mean(depth[group], force[group]) for group in groups])
        sd = np.hypot(_SHARE * np.abs(mean) + _SHARE_OF_LARGEST * mean.max(), error)
        origin = (
            f"sd not given, taken as {100 * _SHARE:g} % of the force + {100 * _SHARE_OF_LARGEST:g} "
            "% of the largest, and the scatter of the rows"
        )
    else:
        of_row = np.broadcast_to(np.asarray(sd_N, dtype=float), len(rows))[used]
        sd, origin = np.array([of_row[group].mean() for group in groups]), "sd as given"
    if not (sd > 0).all():
        raise StudyError(f"{where}: standard deviations of forces must be above 0.")
    averaged = f"{len(depth)} of {len(rows)} rows are deeper than 0, averaged to {len(at)} points"
    return Points(at, mean, sd, f"{averaged}; {origin}")


def _check_press(depth: Array, force: Array, where: str) -> None:
    """Raise StudyError unless averages may be those of a press from first contact."""
    if depth[-1] > _MOST_MM or force.max() > _MOST_N:
        raise StudyError(
            f"{where}: depths to {depth[-1]:.3g} mm and forces to {force.max():.3g} N are not a "
            f"finger's, at most {_MOST_MM:g} mm and {_MOST_N:g} N: check their units."
        )
    deeper = max(np.log(depth[-1] / depth[0]), 1e-9)
    power = np.log(force[-1] / max(force[0], 0.01 * force[-1])) / deeper
    if not _LEAST_POWER <= power <= _LARGEST_POWER:
        raise StudyError(
            f"{where}: depths begin at {depth[0]:.3g} mm, where the force is {force[0]:.3g} N, and "
            f"it grows to {force[-1]:.3g} N at {depth[-1]:.3g} mm: this is no press from first "
            "contact at 0 mm on."
        )


def _groups(depth: Array) -> list[NDArray[np.intp]]:
    """Return the rows of each point: an interval of depth, or a depth if there are few."""
    distinct, number = np.unique(depth, return_inverse=True)
    if len(distinct) > _POINTS:
        number = np.ceil(depth / distinct[-1] * _POINTS - 1e-9).astype(int)
    return [np.flatnonzero(number == k) for k in np.unique(number)]


def _error_of_mean(depth: Array, force: Array) -> float:
    """Return the standard error of a mean force by the scatter about a straight line."""
    if len(depth) < _LEAST_ROWS or np.ptp(depth) == 0:
        return 0.0
    off = force - np.polyval(np.polyfit(depth, force, 1), depth)
    return float(np.sqrt(np.sum(off**2) / (len(depth) - 2) / len(depth)))
