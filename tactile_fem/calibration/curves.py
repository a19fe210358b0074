"""A curve as a test rig writes it, force over depth in many rows, averaged into some points."""

from __future__ import annotations

import csv
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.calibration.contact import first_contact
from tactile_fem.errors import StudyError
from tactile_fem.runtime.number_table import UnusableError, read_table

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Words for a quantity in the name of a column, in the order in which columns are preferred.
_DEPTHS = ("depth", "indentation", "penetration", "displacement", "position", "z", "d")
_FORCES = ("fz", "normal", "force", "load", "f")
_SDS = ("sd", "std", "stdev")
# Words that make it another quantity: not the one that was measured, not along Z, or of it.
_OTHER = frozenset(
    "rate speed velocity vel acceleration target set setpoint setpt sp command commanded cmd "
    "demand demanded desired nominal goal reference ref requested planned limit max maximum min "
    "minimum peak error err deviation sem var variance uncertainty noise offset tare zero preload "
    "trigger threshold time x y lateral tangential shear friction horizontal torque pressure "
    "stress strain work energy stiffness slope temperature voltage ratio percent index number "
    "count".split()
)
# Words at the end of a name that are no unit.
_NO_UNITS = {*_DEPTHS, *_FORCES, *_SDS, *_OTHER} | frozenset(
    "cell sensor channel signal raw filtered corrected measured actual mean average value".split()
)
_G_N, _LB_N = 9.80665e-3, 4.4482216152605  # weights of a gram and of a pound
_MM = {
    **{"mm": 1.0, "um": 1e-3, "\u00b5m": 1e-3, "nm": 1e-6, "cm": 10.0, "m": 1e3},
    **dict.fromkeys(("micron", "microns"), 1e-3),
    **dict.fromkeys(("in", "inch", "inches"), 25.4),
    **dict.fromkeys(("mil", "mils", "thou"), 0.0254),
}
_N = {
    **{"N": 1.0, "mN": 1e-3, "uN": 1e-6, "\u00b5N": 1e-6, "cN": 0.01, "kN": 1e3, "MN": 1e6},
    **dict.fromkeys(("newton", "newtons"), 1.0),
    **dict.fromkeys(("dyn", "dyne", "dynes"), 1e-5),
    **dict.fromkeys(("g", "gf", "gram", "grams"), _G_N),
    **dict.fromkeys(("kg", "kgf", "kp"), 1e3 * _G_N),
    **dict.fromkeys(("lb", "lbs", "lbf"), _LB_N),
    **dict.fromkeys(("oz", "ozf"), _LB_N / 16),
}
_UNITS = {unit.casefold() for unit in (*_MM, *_N, "s", "ms", "min")}
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


class Curve(NamedTuple):
    """A raw curve from its first contact on, as a file has it.

    Attributes
    ----------
    rows
        Depth in mm, force in N and, if the file has it, its sd: (rows, 2) or (rows, 3).
    origin
        From which columns they are, and what was taken for first contact.
    """

    rows: Array
    origin: str


class _Quantity(NamedTuple):
    """What a column may hold: words for it and for what it is not, and its units."""

    words: tuple[str, ...]
    not_words: frozenset[str]
    units: dict[str, float]
    usual: str


_QUANTITIES = (
    _Quantity(_DEPTHS, _OTHER.union(_SDS, _FORCES) - {"normal"}, _MM, "mm"),
    _Quantity(_FORCES, _OTHER.union(_SDS, _DEPTHS) - {"z"}, _N, "N"),
    _Quantity(_SDS, _OTHER.union(_DEPTHS) - {"z"}, _N, "N"),
)


def read_curve(file: Path) -> Array:
    """Return the rows of `curve_of`."""
    return curve_of(file).rows


def curve_of(file: Path) -> Curve:
    """Return a curve of which depths count from first contact, see `first_contact`.

    Of rows in the order of time, they are those until the largest depth. Columns are found by their
    names, which may state units; others are ignored. Two columns without names are depth in mm and
    force in N.

    Raises
    ------
    StudyError
        The file cannot be read, or has no such columns or too few rows; two columns fit equally, or
        state a unit that is not known; or it is no press from first contact.
    """
    try:
        values, header = read_table(file, str(file))
    except UnusableError as error:
        raise StudyError(f"{file} {error}.") from None
    names, chosen = _chosen(header, values.shape[1], file)
    columns, said = [], []
    for k, quantity, what in zip(chosen, _QUANTITIES, ("depth", "force", "sd"), strict=True):
        if k is not None:
            factor, words = _unit(names[k], quantity, file)
            columns.append(values[:, k] * factor)
            said.append(f"{what} from {words}")
    rows = np.column_stack(columns)
    rows = _going_in(rows[np.isfinite(rows).all(axis=1)], file)
    rows[:, :2], contact = from_contact(rows[:, 0], rows[:, 1], f"{file} ({', '.join(said)})")
    origin = ", ".join([*said, *contact])
    logger.info("%s: %s", file, origin)
    return Curve(rows, origin)


def from_contact(depth_mm: Array, force_N: Array, where: str) -> tuple[Array, list[str]]:
    """Return depth and force since first contact, (rows, 2), and what it was in words."""
    contact_mm, offset_N = first_contact(depth_mm, force_N, where)
    said = [f"contact at {contact_mm:.3f} mm"] if contact_mm else []
    said += [f"force offset {offset_N:.3g} N"] if offset_N else []
    return np.column_stack([depth_mm - contact_mm, force_N - offset_N]), said


def _chosen(header: Sequence[str], count: int, file: Path) -> tuple[list[str], list[int | None]]:
    """Return the columns' names and the numbers of those of depth, force and, if any, its sd."""
    lines = [cells for line in header if (cells := _cells(line, count))]
    names, clash = [""] * count, None
    for k in reversed(range(len(lines))):  # with more and more of the lines above the numbers
        names = [" ".join(filter(None, cells)) for cells in zip(*lines[k:], strict=True)]
        depths, forces, sds = (_best(names, quantity) for quantity in _QUANTITIES)
        if depths and forces:
            clash = next((found for found in (depths, forces, sds) if len(found) > 1), None)
            if clash is None:
                return names, [depths[0], forces[0], sds[0] if sds else None]
    if clash:
        raise StudyError(
            f"{file}: the columns {' and '.join(f'"{names[k]}"' for k in clash)} fit equally: "
            "rename those that are not meant."
        )
    named = [part for line in header if len(part := re.split("[;,\t]", line)) > 1]
    if not lines and count == 2 and not any(_best(part, _QUANTITIES[1]) for part in named):
        logger.info("%s names no columns: they are taken as depth in mm and force in N", file)
        return ["depth_mm", "force_N"], [0, 1, None]
    said = " ".join(header[-1:]).strip()
    raise StudyError(
        f"{file}: its columns are {', '.join(filter(None, names)) or said or 'not named'} but must "
        "be depth_mm and force_N, or those of a table that begins with indenter."
    )


def _cells(line: str, count: int) -> list[str] | None:
    """Return the cells of a line above the numbers; None if it has not as many."""
    line = line.strip().lstrip("#").strip()
    for mark in (";", "\t", ",", None):
        cells = next(csv.reader([line], delimiter=mark)) if mark else line.split()
        while len(cells) > count and not cells[-1]:
            cells.pop()
        if len(cells) == count > 1:
            return [cell.strip().strip('"') for cell in cells]
    return None


def _parsed(name: str) -> tuple[list[str], str]:
    """Return the words of a column's name, in small letters, and its unit, which may be empty."""
    name = name.replace("\u03bc", "\u00b5")
    brackets = re.findall(r"[(\[{<]\s*([^)\]}>]*?)\s*[)\]}>]", name)
    plain = re.sub(r"[(\[{<][^)\]}>]*[)\]}>]", " ", name) + " ".join(["", *brackets[:-1]])
    words = re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-z]{2})(?=[A-Z])", " ", plain))
    units = brackets[-1:]
    if not units:
        while len(words) > 1 and words[-1].casefold() in _UNITS:
            units.insert(0, words.pop())
        if len(units) > 1 and units[0] == "in":  # depth in mm
            del units[0]
        if not units and len(words) > 1 and words[-1].isalpha():
            units = [words.pop()] if words[-1].casefold() not in _NO_UNITS else []
    return [word.casefold() for word in words], " ".join(units)


def _best(names: Sequence[str], quantity: _Quantity) -> list[int]:
    """Return the columns that fit best: by the word for the quantity, then with fewest others."""
    rank: dict[int, tuple[int, int]] = {}
    others = {*_MM, *_N} - {*quantity.units}
    for k, name in enumerate(names):
        words, unit = _parsed(name)
        own = [i for i, word in enumerate(quantity.words) if word in words]
        is_of_it = own and not quantity.not_words.intersection(words)
        if is_of_it and unit not in others and not re.search(r"[\s/*^\u00b7]", unit):
            rank[k] = own[0], len(words) - len(own)
    return [k for k in rank if rank[k] == min(rank.values())]


def _unit(name: str, quantity: _Quantity, file: Path) -> tuple[float, str]:
    """Return the factor of a column's unit, and the column in words.

    Capitals count in prefixes (MN, mN); elsewhere they need not be right.
    """
    unit = _parsed(name)[1]
    if not unit:
        logger.warning('%s: column "%s" states no unit: %s is taken', file, name, quantity.usual)
        return 1.0, f'"{name}" (in {quantity.usual})'
    alike = [known for known in quantity.units if known.casefold() == unit.casefold()]
    alike = [known for known in alike if known == unit] or alike
    alike = [known for known in alike if known[0] == unit[0]] or alike
    if len(alike) != 1:
        raise StudyError(
            f'{file}: the unit of column "{name}" is "{unit}" but must be one of '
            f"{', '.join(quantity.units)}."
        )
    factor = quantity.units[alike[0]]
    of_one = f"1 {unit} = {factor:.4g} {quantity.usual}" if factor != 1.0 else quantity.usual
    return factor, f'"{name}" ({of_one})'


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
