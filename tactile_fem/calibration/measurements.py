"""Measured forces over depth and profiles of the skin, read from CSV files.

A row of a table is one number: the normal force at a depth, or the deflection of the skin beside
the indenter.

    indenter,speed_mm_s,depth_mm,force_N,sd_N
    plate,0.2,0.5,0.037,0.010

    indenter,speed_mm_s,depth_mm,place_mm,deflection_mm,sd_mm
    cylinder radius_mm=1.585,0.2,1.0,0.5,0.92,0.05

`indenter` is a kind of stimulus and the keys in which it differs from the default, as in a study's
table [stimulus]. `place_mm` is the distance from the indenter's lowest point, across a bar, else
along the finger; both sides of the indenter are averaged. A file without a column `indenter` is a
raw curve of one press, see `tactile_fem.calibration.curves`.
"""

from __future__ import annotations

import logging
import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, cycle, zip_longest
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError

from tactile_fem.calibration.curves import curve_of, from_contact, points_of
from tactile_fem.errors import StudyError
from tactile_fem.runtime.text import read_rows, read_text
from tactile_fem.study import Stimulus, Study, in_words

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

_COMMON = ("indenter", "speed_mm_s", "depth_mm")
FORCE, PROFILE = ("force_N", "sd_N"), ("place_mm", "deflection_mm", "sd_mm")


@dataclass(frozen=True)
class Experiment:
    """Measurements with one indenter at one speed: one press of the model.

    Attributes
    ----------
    name
        The indenter as written in the file, with its speed.
    depth_mm
        Depth of each measured number, (n,).
    place_mm
        Distance from the indenter where the number is the skin's deflection; NaN where it is the
        normal force, (n,).
    mean, sd
        The numbers and their standard deviations, N or mm, (n,).
    rows
        Depth in mm and force in N as they were measured, (rows, 2), if the numbers are averages.
    origin
        Where the numbers of a raw curve and their standard deviations come from; else empty.
    """

    name: str
    indenter: Stimulus
    speed_mm_s: float
    depth_mm: Array
    place_mm: Array
    mean: Array
    sd: Array
    rows: Array = field(default_factory=lambda: np.empty((0, 2)))
    origin: str = ""

    @classmethod
    def of_curve(
        cls,
        indenter: Stimulus | str,
        speed_mm_s: float,
        depth_mm: ArrayLike,
        force_N: ArrayLike,
        sd_N: ArrayLike | None = None,
    ) -> Self:
        """Return a press of which many rows were measured; they are averaged.

        Raises StudyError if there are too few rows, they are no press from first contact, or speed
        or `sd_N` is not above 0.

        Parameters
        ----------
        indenter
            A stimulus such as ``Sphere(radius_mm=2.0)``, or how a file names it.
        speed_mm_s
            Speed of the indenter.
        depth_mm, force_N
            Depth and normal force, (rows,), in any order. If the force shows that it does not begin
            at 0, depth is counted from where it does, and the offset of the force is subtracted;
            `origin` says so. Rows before contact are left out.
        sd_N
            Standard deviation of the forces: one, or (rows,). Default 5 % of each average and 1 %
            of the largest, with the scatter of the rows.
        """
        if not (math.isfinite(speed_mm_s) and speed_mm_s > 0):
            raise StudyError(f"speed is {speed_mm_s:g} mm/s but must be above 0.")
        if isinstance(indenter, str):
            name, body = indenter, parse_indenter(indenter, "indenter")
        else:
            name, body = indenter.kind, indenter
        name = f"{name} at {speed_mm_s:g} mm/s"
        rows, said = from_contact(np.asarray(depth_mm, float), np.asarray(force_N, float), name)
        if said:
            logger.info("%s: %s", name, ", ".join(said))
        depth, force, sd, origin = points_of(rows[:, 0], rows[:, 1], sd_N, name)
        place = np.full_like(depth, np.nan)
        words = "; ".join([origin, *said])
        return cls(name, body, speed_mm_s, depth, place, force, sd, rows, words)

    @property
    def is_force(self) -> NDArray[np.bool_]:
        """Which numbers are normal forces, (n,)."""
        return np.isnan(self.place_mm)


def read_measurements(
    files: Sequence[Path | str],
    *,
    indenters: Sequence[str] = (),
    speed_mm_s: float | None = None,
    sd_N: float | None = None,
) -> list[Experiment]:
    """Return the experiments of text files, one for each indenter and speed.

    Parameters
    ----------
    files
        Tables of measurements, or raw curves: columns of depth and force of a press.
    indenters
        Of the raw curves, as a table names them (``sphere radius_mm=2``): one for all, or one for
        each in turn.
    speed_mm_s
        Speed of the press of raw curves.
    sd_N
        Standard deviation of the forces of raw curves; default see `Experiment.of_curve`.

    Returns
    -------
    list of Experiment
        What `tactile_fem.fit` takes.

    Raises
    ------
    StudyError
        A file cannot be read, or a row is wrong: file, line, value and what is allowed; a raw curve
        lacks its indenter or speed, or there is one too many.
    """
    paths = [Path(file) for file in files]
    raw = [path for path in paths if not _is_table(path)]
    found = _of_tables([path for path in paths if path not in raw])
    found += _of_curves(raw, indenters, speed_mm_s, sd_N)
    if not found:
        raise StudyError("There are no measurements: name one or more CSV files.")
    return found


def _is_table(file: Path) -> bool:
    """Return whether the first row of a file names a column `indenter`."""
    first = read_text(file, str(file), western=True, binary="it is no CSV file").lstrip()
    return "indenter" in first.partition("\n")[0]


def _of_tables(files: Sequence[Path]) -> list[Experiment]:
    rows: dict[tuple[str, float], list[tuple[float, ...]]] = {}
    indenters: dict[str, Stimulus] = {}
    for where, cells in chain.from_iterable(map(_lines, files)):
        name, speed, numbers = _row(where, cells)
        if name not in indenters:
            indenters[name] = parse_indenter(name, where)
        rows.setdefault((name, speed), []).append(numbers)
    return [
        Experiment(
            f"{name} at {speed:g} mm/s",
            indenters[name],
            speed,
            *np.array(sorted(own, key=lambda row: (math.isfinite(row[1]), *row[:2]))).T,
        )
        for (name, speed), own in rows.items()
    ]


def _of_curves(
    files: Sequence[Path], indenters: Sequence[str], speed_mm_s: float | None, sd_N: float | None
) -> list[Experiment]:
    given = {"indenter": bool(indenters), "speed": speed_mm_s is not None, "sd": sd_N is not None}
    if not files and any(given.values()):
        names = " and ".join(name for name, is_given in given.items() if is_given)
        raise StudyError(f"{names} must not be given: no file is a raw curve, and tables state it.")
    curves = [curve_of(file) for file in files]
    if not curves:
        return []
    if not indenters or speed_mm_s is None:
        raise StudyError(
            f"{files[0]} is a raw curve: its indenter, such as plate or sphere radius_mm=2, and "
            "its speed in mm/s must be given."
        )
    if len(indenters) not in (1, len(files)):
        raise StudyError(
            f"{len(indenters)} indenters are given for {len(files)} raw curves: give one, or one "
            "for each."
        )
    presses: dict[str, list[tuple[Array, str]]] = {}
    for indenter, curve in zip(cycle(indenters), curves, strict=False):
        presses.setdefault(" ".join(indenter.split()), []).append(curve)
    found = []
    for indenter, equal in presses.items():
        width = min(rows.shape[1] for rows, _ in equal)  # 3 if all have an sd of their own
        depth, force, *own = np.vstack([rows[:, :width] for rows, _ in equal]).T
        sd = sd_N if sd_N is not None or not own else own[0]
        one = Experiment.of_curve(indenter, speed_mm_s, depth, force, sd)
        origins = [one.origin, *(origin for _, origin in equal)]
        found.append(replace(one, origin="; ".join(origins)))
    return found


def deviations(experiments: Sequence[Experiment], values: Sequence[Array]) -> Array:
    """Return model less measurement, in standard deviations, of all experiments' numbers."""
    return np.concatenate([(v - e.mean) / e.sd for v, e in zip(values, experiments, strict=True)])


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
        raise StudyError(f"{where}: {in_words(error)}") from None


def _lines(file: Path) -> Iterable[tuple[str, dict[str, str]]]:
    """Yield file and line of each row, and its cells by their columns."""
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
        where = f"{file}, line {line}"
        if len(row) > len(names):
            raise StudyError(f"{where}: it has more cells than there are columns.")
        yield where, dict(zip_longest(names, row, fillvalue=""))


def _row(where: str, cells: Mapping[str, str]) -> tuple[str, float, tuple[float, ...]]:
    """Return indenter and speed of a row, and depth, place, measured number and its sd."""

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
        return indenter, speed, (depth, math.nan, number("force_N"), number("sd_N"))
    place = abs(number("place_mm", positive=False))
    deflection = number("deflection_mm", positive=False)
    return indenter, speed, (depth, place, deflection, number("sd_mm"))
