"""Measured forces over depth and profiles of the skin, read from CSV files.

A row is one number: the normal force at a depth, or the deflection of the skin beside the indenter.

    indenter,speed_mm_s,depth_mm,force_N,sd_N
    plate,0.2,0.5,0.037,0.010

    indenter,speed_mm_s,depth_mm,place_mm,deflection_mm,sd_mm
    cylinder radius_mm=1.585,0.2,1.0,0.5,0.92,0.05

`indenter` is a kind of stimulus and the keys in which it differs from the default, as in a study's
table [stimulus]. `place_mm` is the distance from the indenter's lowest point, across a bar, else
along the finger; both sides of the indenter are averaged.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from tactile_fem.errors import StudyError
from tactile_fem.runtime.text import read_rows
from tactile_fem.study import Stimulus, Study
from tactile_fem.study.explain import explain

Array = NDArray[np.float64]

_COMMON = ("indenter", "speed_mm_s", "depth_mm")
FORCE, PROFILE = ("force_N", "sd_N"), ("place_mm", "deflection_mm", "sd_mm")


@dataclass(frozen=True)
class Experiment:
    """What was measured with one indenter at one speed: one press of the model.

    Attributes
    ----------
    name
        The indenter as it is written in the file, with its speed.
    depth_mm
        Depth of each measured number, (n,).
    place_mm
        Distance from the indenter where the number is the skin's deflection; NaN where it is the
        normal force, (n,).
    mean, sd
        The numbers and their standard deviations, N or mm, (n,).
    """

    name: str
    indenter: Stimulus
    speed_mm_s: float
    depth_mm: Array
    place_mm: Array
    mean: Array
    sd: Array

    @property
    def is_force(self) -> NDArray[np.bool_]:
        """Which numbers are normal forces, (n,)."""
        return np.isnan(self.place_mm)


class _Row(NamedTuple):
    indenter: str
    speed_mm_s: float
    depth_mm: float
    place_mm: float
    mean: float
    sd: float


def read_measurements(files: Sequence[Path]) -> list[Experiment]:
    """Return the experiments of CSV files, one for each indenter and speed.

    Raises
    ------
    StudyError
        A file cannot be read, or a row is wrong: file, line, value and what is allowed.
    """
    rows: dict[tuple[str, float], list[_Row]] = {}
    indenters: dict[str, Stimulus] = {}
    for file in files:
        for line, cells in _lines(file):
            where = f"{file}, line {line}"
            row = _row(where, cells)
            if row.indenter not in indenters:
                indenters[row.indenter] = parse_indenter(row.indenter, where)
            rows.setdefault((row.indenter, row.speed_mm_s), []).append(row)
    if not rows:
        raise StudyError("There are no measurements: name one or more CSV files.")
    return [_experiment(indenters[indenter], of_press) for (indenter, _), of_press in rows.items()]


def parse_indenter(text: str, where: str) -> Stimulus:
    """Return the stimulus that ``kind key=value key=value`` names."""
    kind, *settings = text.split()
    table: dict[str, object] = {"kind": kind}
    for setting in settings:
        try:
            table.update(tomllib.loads(setting))
        except tomllib.TOMLDecodeError:
            raise StudyError(f'{where}: "{setting}" is no key=value of an indenter.') from None
    try:
        return Study.model_validate({"stimulus": table}).stimulus
    except ValidationError as error:
        raise StudyError(f"{where}: {explain(error)}") from None


def _lines(file: Path) -> Iterable[tuple[int, dict[str, str]]]:
    rows = read_rows(file, str(file))
    names = [name.strip() for name in rows[0][1]] if rows else []
    for kind in (FORCE, PROFILE):
        if sorted(names) == sorted([*_COMMON, *kind]):
            break
    else:
        raise StudyError(
            f"{file}: its columns are {', '.join(names) or 'none'} but must be "
            f"{', '.join([*_COMMON, *FORCE])} or {', '.join([*_COMMON, *PROFILE])}."
        )
    for line, row in rows[1:]:
        if len(row) > len(names):
            raise StudyError(f"{file}, line {line}: it has more cells than there are columns.")
        yield line, dict(zip_longest(names, row, fillvalue=""))


def _row(where: str, cells: Mapping[str, str]) -> _Row:
    def number(name: str, *, positive: bool = True) -> float:
        text = cells[name].strip()
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (positive and value <= 0):
            allowed = "a number above 0" if positive else "a number"
            raise StudyError(f'{where}: {name} is "{text}" but must be {allowed}.')
        return value

    indenter = " ".join(cells["indenter"].split())
    if not indenter:
        raise StudyError(f"{where}: indenter is empty but must be a kind of stimulus.")
    speed, depth = number("speed_mm_s"), number("depth_mm")
    if "force_N" in cells:
        return _Row(indenter, speed, depth, math.nan, number("force_N"), number("sd_N"))
    place = abs(number("place_mm", positive=False))
    deflection = number("deflection_mm", positive=False)
    return _Row(indenter, speed, depth, place, deflection, number("sd_mm"))


def _experiment(indenter: Stimulus, rows: Sequence[_Row]) -> Experiment:
    rows = sorted(rows, key=lambda row: (math.isfinite(row.place_mm), row.depth_mm, row.place_mm))
    speed = rows[0].speed_mm_s
    columns = np.array([row[2:] for row in rows]).T
    return Experiment(f"{rows[0].indenter} at {speed:g} mm/s", indenter, speed, *columns)
