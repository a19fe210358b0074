"""Raw curves of a test rig, force over depth: from first contact on, averaged into some points.

At the lowest forces of a press the force grows as a power of the depth. So

    F = F_0 + k max(z - z_0, 0)^p,    1 <= p <= 2.75,

is fitted to them, with an offset ``F_0`` if there are rows before contact. Only where this rejects
``z_0 = 0`` do positions count from elsewhere: a curve that is tared stays as it is.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.calibration.columns import chosen
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


class Points(NamedTuple):
    """Averages over some of a curve's rows, (n,), and where their standard deviation is from."""

    depth_mm: Array
    force_N: Array
    sd_N: Array
    origin: str


def curve_of(file: Path) -> tuple[Array, str]:
    """Return depth since first contact in mm, force in N and, if the file has it, its sd.

    They are (rows, 2) or (rows, 3), with words on columns and contact. Of rows in the order of
    time, they are those until the largest depth. For the columns see `columns.chosen`.

    Raises StudyError if the file cannot be read, has no such columns, or its force does not grow
    with the depth.
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

    Raises StudyError, which begins with `where`, if there are too few rows, no force at the largest
    depth, or one that does not grow as in a press from first contact.
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


_POWERS = np.arange(1.0, 2.76, 0.125)
# Share of the largest force up to which the law is fitted: above, fingers stiffen.
_LOWEST = 0.12
# Standard deviation of a force in the fit, as shares of it and of the largest.
_FIT_SHARE, _FIT_SHARE_OF_LARGEST = 0.03, 0.005
# Averages that are fitted; rows that are needed in all, before contact, and in the fit after it.
_AVERAGES, _FITTED_ROWS, _BEFORE, _AFTER = 1000, 5, 2, 6
_TRIED = 121  # positions of contact, in each of two rounds
# Contact is not at 0 if it, or the force before, is off by this share of the press and 0 adds so
# many variances to the sum of squares, more of them with few degrees of freedom. The least variance
# is that of deviations in their standard deviations.
_OFF, _REJECTED, _MORE_OF_FEW, _LEAST_VARIANCE = 0.05, 12.0, 8.0, 0.1
_NO_OFFSET = 1e-6  # share of the largest force


def from_contact(depth_mm: Array, force_N: Array, where: str) -> tuple[Array, list[str]]:
    """Return depth and force of a curve since first contact, (rows, 2), and what it was in words.

    The rows may be in any order. Contact is at 0 unless the force shows another position; without
    rows before it there is no offset of the force. Raises StudyError, which begins with `where`, if
    the depth does not change, or the force falls with it.
    """
    order = np.argsort(depth_mm, kind="stable")
    order = order[np.isfinite(depth_mm + force_N)[order]]
    z, force = depth_mm[order], force_N[order]
    if len(z) and z[0] == z[-1]:
        raise StudyError(f"{where}: the depth does not change, so there is no press.")
    changes = len(z) > 1 and np.ptp(force) > 0
    if changes and np.corrcoef(z, force)[0, 1] < 0:
        raise StudyError(
            f"{where}: the force at the largest depth is {force[-1]:.3g} N but must be above 0 and "
            f"the largest; it is {force[0]:.3g} N at the smallest, {z[0]:.3g} mm. Depths must grow "
            "into the finger, and forces are positive where it is pressed."
        )
    contact_mm = _fitted(z, force) if changes and len(z) >= _FITTED_ROWS else 0.0
    before = force[z < contact_mm]
    offset_N = float(np.median(before)) if len(before) >= _BEFORE else 0.0
    said = [f"contact at {contact_mm:.3f} mm"] if contact_mm else []
    if abs(offset_N) > _NO_OFFSET * np.ptp(force):
        said.append(f"force offset {offset_N:.3g} N")
    return np.column_stack([depth_mm - contact_mm, force_N - offset_N]), said


def _fitted(z: Array, force: Array) -> float:
    """Return the position of first contact of rows in the order of their position."""
    parts = np.array_split(np.arange(len(z)), min(len(z), _AVERAGES))
    z, force = (np.array([of[part].mean() for part in parts]) for of in (z, force))
    rise = force - np.sort(force)[: max(_BEFORE, len(force) // 20)].mean()
    after = np.sort(rise[rise > 0.01 * rise.max()])[:_AFTER]
    end = np.flatnonzero(rise <= max(_LOWEST * rise.max(), after[-1]))[-1] + 1
    sd = np.hypot(_FIT_SHARE * rise, _FIT_SHARE_OF_LARGEST * rise.max())
    lowest = z[:end], force[:end], sd[:end]
    tried = np.linspace(z[0] - (z[end - 1] - z[0]) / 2, z[end - _BEFORE], _TRIED)
    for _ in range(2):
        squares = [_squares(at, *lowest) for at in tried]
        contact, step = float(tried[np.argmin(squares)]), tried[1] - tried[0]
        tried = np.linspace(contact - step, contact + step, _TRIED)
    freedom = max(end - 4, 1)
    variance = max(min(squares) / freedom, _LEAST_VARIANCE)
    excess = (_squares(0.0, *lowest) - min(squares)) / variance
    before = force[z < contact]
    if len(before) < _BEFORE or excess < _REJECTED * (1 + _MORE_OF_FEW / freedom):
        return 0.0
    is_off = abs(contact) > _OFF * (z[-1] - contact)
    return contact if is_off or abs(np.median(before)) > _OFF * rise.max() else 0.0


def _squares(contact: float, z: Array, force: Array, sd: Array) -> float:
    """Return the least sum of squares of the law with its contact there."""
    depth = np.maximum(z - contact, 0.0) / max(z[-1] - contact, 1e-9)
    law = np.where(depth > 0, depth ** _POWERS[:, None], 0.0) / sd  # (powers, rows)
    flat, values = 1 / sd, force / sd
    if np.count_nonzero(depth == 0) >= _BEFORE:  # with an offset: without its share of both
        law = law - np.outer(law @ flat, flat) / (flat @ flat)
        values = values - flat * (flat @ values) / (flat @ flat)
    slopes = np.maximum(law @ values, 0.0) / np.maximum(np.sum(law**2, axis=1), 1e-30)
    return float(np.sum((values - slopes[:, None] * law) ** 2, axis=1).min())
