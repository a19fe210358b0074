"""A curve as a test rig writes it, force over depth in many rows, averaged into some points."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.runtime.number_table import UnusableError, read_table

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Words for a quantity in the name of a column, in the order in which columns are preferred.
_DEPTH = ("depth", "indentation", "penetration", "displacement", "position", "z", "d")
_FORCE = ("fz", "normal", "force", "load", "f")
_SD = ("sd", "std", "stdev")
_MM = {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "cm": 10.0, "m": 1e3}
_N = {"n": 1.0, "mn": 1e-3, "un": 1e-6, "µn": 1e-6, "cn": 0.01, "gf": 9.80665e-3}
# Points of a curve with more rows, which are averaged; as many steps of the model end at them.
_POINTS = 12
_LEAST_ROWS = 3
# Standard deviation of a point unless it is given: shares of its force and of the largest.
_SHARE, _SHARE_OF_LARGEST = 0.05, 0.01
# Rows in the order of time: their depth correlates with their number. A hold begins at this share
# of the depth.
_IN_TIME, _AT_DEPTH, _FEW = 0.8, 0.995, 0.05


@dataclass(frozen=True)
class Points:
    """Averages over some of a curve's rows, (n,), and where their standard deviation is from."""

    depth_mm: Array
    force_N: Array
    sd_N: Array
    origin: str


def read_curve(file: Path) -> Array:
    """Return depth in mm, force in N and, if the file has it, its sd: (rows, 2) or (rows, 3).

    Of rows in the order of time, they are those until the largest depth. Columns are found by their
    names, which may state units; others are ignored. Two columns without names are depth in mm and
    force in N.

    Raises
    ------
    StudyError
        The file cannot be read, or has no such columns or too few rows.
    """
    try:
        values, header = read_table(file, str(file))
    except UnusableError as error:
        raise StudyError(f"{file} {error}.") from None
    names = _names(header, values.shape[1])
    if not any(names) and len(names) == 2:
        names = ["depth_mm", "force_N"]
        logger.info("%s names no columns: they are taken as depth in mm and force in N", file)
    depth, force, sd = (_column(names, words) for words in (_DEPTH, _FORCE, _SD))
    if depth is None or force is None:
        raise StudyError(
            f"{file}: its columns are {', '.join(names) if any(names) else 'not named'} but must "
            "be depth_mm and force_N, or those of a table that begins with indenter."
        )
    columns = [values[:, depth] * _unit(names[depth], _MM, "mm", file)]
    columns += [values[:, k] * _unit(names[k], _N, "N", file) for k in (force, sd) if k is not None]
    rows = np.column_stack(columns)
    return _going_in(rows[np.isfinite(rows).all(axis=1)], file)


def _names(header: Sequence[str], count: int) -> list[str]:
    """Return the name of each column: what the lines above it say, which have as many cells."""
    names = [""] * count
    for line in header:
        line = line.strip().lstrip("#").strip()
        cells = next((c for c in (re.split(p, line) for p in ("[;,\t]", r"\s+")) if len(c) > 1), [])
        if len(cells) == count:
            cells = [cell.strip().strip('"') for cell in cells]
            names = [" ".join(filter(None, pair)) for pair in zip(names, cells, strict=True)]
    return names


def _words(name: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", name.casefold().replace("\u03bc", "\u00b5"))


def _column(names: Sequence[str], words: Sequence[str]) -> int | None:
    """Return the column whose name has the first of some words that any has."""
    is_sd = [any(word in _SD for word in _words(name)) for name in names]
    for word in words:
        for k, name in enumerate(names):
            if word in _words(name) and (is_sd[k] == (words is _SD)):
                return k
    return None


def _unit(name: str, units: dict[str, float], usual: str, file: Path) -> float:
    """Return the factor of the unit in a column's name."""
    found = [units[word] for word in _words(name)[1:] if word in units]
    if not found:
        logger.warning(
            '%s: column "%s" states no unit that is known: %s is taken', file, name, usual
        )
    return found[-1] if found else 1.0


def _going_in(rows: Array, file: Path) -> Array:
    """Return the rows until the largest depth, where they follow each other in time."""
    depth = rows[:, 0]
    end = int(np.argmax(depth >= _AT_DEPTH * depth.max(initial=0.0))) + 1
    if end < _LEAST_ROWS or len(rows) - end <= _FEW * len(rows):
        return rows
    if np.ptp(depth[:end]) == 0 or np.corrcoef(depth[:end], np.arange(end))[0, 1] < _IN_TIME:
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
        There are too few rows, or no force at the largest depth; the message begins with `where`.
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
