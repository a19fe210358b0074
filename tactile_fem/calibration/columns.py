"""Which columns of a table are depth, force and its standard deviation, by names with units."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Words for a quantity, in the order in which columns are preferred.
_DEPTHS = ("depth", "indentation", "penetration", "displacement", "position", "z", "d")
_FORCES = ("fz", "normal", "force", "load", "f")
_SDS = ("sd", "std", "stdev")
# Words that make it another quantity: not measured, not along Z, or of it.
_OTHER = frozenset(
    "rate speed velocity vel acceleration target set setpoint setpt sp command commanded cmd "
    "demand demanded desired nominal goal reference ref requested planned limit max maximum min "
    "minimum peak error err deviation sem var variance uncertainty noise offset tare zero preload "
    "trigger threshold time x y lateral tangential shear friction horizontal torque pressure "
    "stress strain work energy stiffness slope temperature voltage ratio percent index number "
    "count".split()
)
_G_N, _LB_N = 9.80665e-3, 4.4482216152605  # weights of a gram and of a pound
_MM = {"mm": 1.0, "um": 1e-3, "\u00b5m": 1e-3, "nm": 1e-6, "cm": 10.0, "m": 1e3}
_MM |= {"in": 25.4, "inch": 25.4, "inches": 25.4, "mil": 0.0254, "micron": 1e-3, "microns": 1e-3}
_N = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "\u00b5N": 1e-6, "cN": 0.01, "kN": 1e3, "MN": 1e6}
_N |= {"g": _G_N, "gf": _G_N, "kg": 1e3 * _G_N, "kgf": 1e3 * _G_N, "kp": 1e3 * _G_N, "dyn": 1e-5}
_N |= {"lb": _LB_N, "lbs": _LB_N, "lbf": _LB_N, "oz": _LB_N / 16, "ozf": _LB_N / 16}
_UNITS = {unit.casefold() for unit in (*_MM, *_N, "s", "ms", "min")}


class _Quantity(NamedTuple):
    """What a column may hold: words for it and for what it is not, and its units."""

    name: str
    words: tuple[str, ...]
    not_words: frozenset[str]
    units: dict[str, float]  # the first is usual


_QUANTITIES = (
    _Quantity("depth", _DEPTHS, _OTHER.union(_SDS, _FORCES) - {"normal"}, _MM),
    _Quantity("force", _FORCES, _OTHER.union(_SDS, _DEPTHS) - {"z"}, _N),
    _Quantity("sd", _SDS, _OTHER.union(_DEPTHS) - {"z"}, _N),
)


def chosen(values: Array, header: Sequence[str], file: Path) -> tuple[Array, str]:
    """Return depth in mm, force in N and, if there is one, its sd, and in words which these are.

    Of all columns, (rows, columns), they are found by their names in the lines above, which may
    state units. Two columns without names are depth in mm and force in N. Raises StudyError, which
    begins with the file, if there are no such columns, two fit equally, or a unit is not known.
    """
    count, names, clash = values.shape[1], list[str](), list[str]()
    lines = [cells for line in header if (cells := _cells(line, count))]
    for k in reversed(range(len(lines))):  # with more and more of the lines above the numbers
        names = [" ".join(filter(None, cells)) for cells in zip(*lines[k:], strict=True)]
        depths, forces, sds = found = [_best(names, quantity) for quantity in _QUANTITIES]
        if depths and forces:
            clash = next(([f'"{names[i]}"' for i in those] for those in found if those[1:]), [])
            if not clash:
                return _in_units(values, names, [depths[0], forces[0], *sds], file)
    if clash:
        raise StudyError(
            f"{file}: the columns {' and '.join(clash)} fit equally: rename those not meant."
        )
    shown = [*filter(None, names)] or [line.strip() for line in header[-1:]]
    parts = [re.split("[;,\t]", line) for line in shown]
    if count == 2 and not lines and not any(_best(part, _QUANTITIES[1]) for part in parts):
        logger.info("%s does not name its columns: depth in mm and force in N are assumed", file)
        return _in_units(values, ["depth_mm", "force_N"], [0, 1], file)
    raise StudyError(
        f"{file}: its columns are {', '.join(shown) or 'not named'} but must be depth_mm and "
        "force_N, or those of a table that begins with indenter."
    )


def _in_units(
    values: Array, names: Sequence[str], columns: Sequence[int], file: Path
) -> tuple[Array, str]:
    """Return the columns of the quantities in mm and N, and in words which these are."""
    factors, said = [], []
    for k, quantity in zip(columns, _QUANTITIES, strict=False):
        factor, unit = _unit(names[k], quantity, file)
        factors.append(factor)
        said.append(f'{quantity.name} from "{names[k]}" ({unit})')
    return values[:, columns] * factors, ", ".join(said)


def _cells(line: str, count: int) -> list[str]:
    """Return the cells of a line above the numbers; none if it has not as many."""
    line = line.strip("# ").rstrip(";,\t ")
    tries = ([cell.strip(' "') for cell in line.split(mark)] for mark in (";", "\t", ",", None))
    return next((cells for cells in tries if len(cells) == count > 1), [])


def _parsed(name: str) -> tuple[list[str], str]:
    """Return the words of a column's name, in small letters, and its unit, which may be empty."""
    name = name.replace("\u03bc", "\u00b5")
    *others, unit = re.findall(r"[(\[{<]\s*([^)\]}>]*?)\s*[)\]}>]", name) or [""]
    plain = " ".join([re.sub(r"[(\[{<][^)\]}>]*[)\]}>]", " ", name), *others])
    words = re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-z]{2})(?=[A-Z])", " ", plain))
    units: list[str] = []
    while not unit and len(words) > 1 and words[-1].casefold() in _UNITS:
        units.insert(0, words.pop())
    if units[1:] and units[0] == "in":  # depth in mm
        del units[0]
    return [word.casefold() for word in words], unit or " ".join(units)


def _best(names: Sequence[str], quantity: _Quantity) -> list[int]:
    """Return the columns that fit best: by the word for the quantity, then with fewest others."""
    rank: dict[int, tuple[int, int]] = {}
    for k, name in enumerate(names):
        words, unit = _parsed(name)
        own = [i for i, word in enumerate(quantity.words) if word in words]
        is_other = quantity.not_words.intersection(words) or re.search(r"[\s/*^\u00b7]", unit)
        if own and not is_other and unit not in {*_MM, *_N} - {*quantity.units}:
            rank[k] = own[0], len(words) - len(own)
    return [k for k in rank if rank[k] == min(rank.values())]


def _unit(name: str, quantity: _Quantity, file: Path) -> tuple[float, str]:
    """Return the factor of a column's unit, and the unit in words.

    Capitals count in prefixes (MN, mN); elsewhere they need not be right.
    """
    (words, unit), usual = _parsed(name), next(iter(quantity.units))
    if not unit and {*words} <= {*quantity.words}:
        logger.warning('%s: column "%s" has no unit: %s is assumed', file, name, usual)
        return 1.0, f"in {usual}"
    alike = [known for known in quantity.units if known.casefold() == unit.casefold()]
    for same in (lambda known: known == unit, lambda known: known[0] == unit[0]):
        alike = [*filter(same, alike)] or alike
    if len(alike) != 1:
        raise StudyError(
            f'{file}: the unit of column "{name}" must be one of {", ".join(quantity.units)}.'
        )
    factor = quantity.units[alike[0]]
    return factor, usual if factor == 1 else f"1 {unit} = {factor:.4g} {usual}"
