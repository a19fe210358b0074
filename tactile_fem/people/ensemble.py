"""Run the incomplete scans of an ensemble and read its results.

Beside the study file and the results folder of each scan, ``people.csv`` has the values and
standard scores of each person, and ``….failed.txt`` the reason why a scan failed.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem import Results
from tactile_fem.errors import StudyError
from tactile_fem.people.draw import Person
from tactile_fem.results import history
from tactile_fem.runtime.files import write_table
from tactile_fem.series import (
    Member,
    Outcome,
    collected,
    keep_reason,
    numbers_of,
    reason_of,
    run_series,
)
from tactile_fem.simulation import check

Array = NDArray[np.float64]
History = Callable[[Results], Array]

_TABLE = "people.csv"
_SCORE, _DRAW = "score of ", "draw of "
_OF_SCAN = ("scan", "person", "condition")


def run_people(
    scans: Sequence[Person], folder: Path | str, *, jobs: int = 1, ranks: int = 1
) -> list[Outcome]:
    """Run the scans of an ensemble that are not complete, see `tactile_fem.series.run_series`.

    A finger that cannot be meshed or pressed is counted: its outcome has the reason, which is kept
    in the folder.

    Raises
    ------
    StudyError
        Bad input, before anything runs; or the folder contains another ensemble.
    StoppedError
        SIGTERM or SIGINT was received; the running scans have been asked to stop.
    """
    possible = begin_people(scans, folder)
    done = {o.member.name: o for o in run_series(possible, folder, jobs=jobs, ranks=ranks)}
    impossible = {one.member.name: one for one in collected(scans, folder)}
    return [done.get(scan.name) or impossible[scan.name] for scan in scans]


def begin_people(scans: Sequence[Person], folder: Path | str) -> list[Person]:
    """Write the table of an ensemble; return the scans that can run.

    The folder keeps the reason for the others. Raises what `run_people` does.
    """
    folder = Path(folder)
    problems = {scan.name: _problem(scan) for scan in scans}
    _write_table(scans, folder)
    for scan in scans:
        if problems[scan.name]:
            keep_reason(Outcome(scan, problems[scan.name], 0.0), folder)
    return [scan for scan in scans if not problems[scan.name]]


def collect_people(scans: Sequence[Person], folder: Path | str) -> list[Outcome]:
    """Return the outcomes of scans of an ensemble that ran elsewhere."""
    _write_table(scans, Path(folder))
    return collected(scans, folder)


def _problem(scan: Member) -> str:
    """Return why a finger is impossible; empty if nothing is known against it."""
    try:
        check(scan.study)
    except StudyError as error:
        return str(error)
    return ""


def _write_table(scans: Sequence[Person], folder: Path) -> None:
    """Write values and standard scores of each scan, unless they are there already.

    Raises
    ------
    StudyError
        The folder cannot be used, or has the table of other people or other conditions.
    """
    rows = {
        scan.name: {
            **dict(zip(_OF_SCAN, (scan.name, scan.person, scan.condition), strict=True)),
            **scan.values,
            **{f"{_SCORE}{name}": score for name, score in scan.scores.items()},
            **{f"{_DRAW}{name}": score for name, score in scan.draws.items()},
        }
        for scan in scans
    }
    columns = dict.fromkeys(name for row in rows.values() for name in row)
    now = [{name: str(row.get(name, "")) for name in columns} for row in rows.values()]
    path = folder / _TABLE
    try:
        before = _read_table(path) if path.exists() else []
        common = min(len(before), len(now))  # the first of a larger ensemble are a smaller one
        if before[:common] != now[:common]:
            raise StudyError(f"{path} belongs to another ensemble: choose another folder.")
        folder.mkdir(parents=True, exist_ok=True)
        if len(now) > len(before):
            with suppress(FileNotFoundError):  # another task has just written it
                write_table(path, now)
    except OSError as error:
        raise StudyError(f"The folder {folder} cannot be used: {error.strerror}.") from None


def _read_table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@dataclass(frozen=True)
class Ensemble:
    """The people in a folder that `run_people` wrote; no scan is run.

    A person is complete if the scans of all conditions are. Results, numbers and histories are
    those of the complete people, so that conditions can be compared within people;
    ``scores[complete]`` are their scores.

    Attributes
    ----------
    folder
        Folder of the ensemble.
    people
        Names of all people, (n,).
    conditions
        Names of the conditions; one empty name if there is one condition only.
    names
        What varies between people, (k,).
    scores
        Standard scores of what varies, (n, k): standard deviations from the middle, correlated as a
        fit's parameters are.
    draws
        The independent scores behind them, (n, k): what each adds to those before it.
    """

    folder: Path
    people: tuple[str, ...]
    conditions: tuple[str, ...]
    names: tuple[str, ...]
    scores: Array
    draws: Array

    @classmethod
    def open(cls, folder: Path | str) -> Ensemble:
        """Return the ensemble of a folder.

        Raises
        ------
        StudyError
            The folder holds none.
        """
        folder = Path(folder)
        try:
            rows = _read_table(folder / _TABLE)
            names = tuple(key.removeprefix(_SCORE) for key in rows[0] if key.startswith(_SCORE))
            of_person = {row["person"]: row for row in rows}
            each = of_person.values()
            scores = [[float(r[f"{_SCORE}{name}"]) for name in names] for r in each]
            draws = [[float(r.get(f"{_DRAW}{n}", r[f"{_SCORE}{n}"])) for n in names] for r in each]
            conditions = tuple(dict.fromkeys(row["condition"] for row in rows))
        except (OSError, ValueError, KeyError, IndexError):
            raise StudyError(f"{folder} holds no ensemble: there is no {_TABLE} in it.") from None
        found = tuple(of_person), conditions, names, np.array(scores), np.array(draws)
        return cls(folder, *found)

    @cached_property
    def _scans(self) -> dict[tuple[str, str], Results]:
        """The scans by person and condition; each reads its files once."""
        return {
            (person, condition): Results(
                self.folder / (f"{person}_{condition}" if condition else person)
            )
            for person in self.people
            for condition in self.conditions
        }

    @cached_property
    def complete(self) -> NDArray[np.bool_]:
        """Which people are complete, (n,)."""
        return np.array(
            [all(self._scans[p, c].complete for c in self.conditions) for p in self.people]
        )

    @property
    def failed(self) -> dict[str, str]:
        """Why scans failed, in one sentence, by their names."""
        each = {s.folder.name: reason_of(s.folder) for s in self._scans.values() if not s.complete}
        return {name: why for name, why in each.items() if why}

    def of_all(self, values: ArrayLike) -> Array:
        """Return values (m, ...) of the complete people among NaN of the others, (n, ...)."""
        own = np.asarray(values, dtype=float)
        found = np.full((len(self.people), *own.shape[1:]), np.nan)
        found[self.complete] = own
        return found

    def results(self, condition: str | None = None) -> list[Results]:
        """Return the scans of the complete people, (m,), in their order.

        Parameters
        ----------
        condition
            Name of the condition; by default the first.

        Raises
        ------
        StudyError
            There is no such condition, or nobody is complete.
        """
        name = self.conditions[0] if condition is None else condition
        if name not in self.conditions:
            raise StudyError(
                f"{self.folder} has no condition {name}: {', '.join(self.conditions)}."
            )
        if not self.complete.any():
            raise StudyError(f"Nobody in {self.folder} is complete: run the ensemble first.")
        whole = np.array(self.people)[self.complete].tolist()
        return [self._scans[person, name] for person in whole]

    def numbers(self, condition: str | None = None) -> dict[str, Array]:
        """Return the numbers of `tactile_fem.series.numbers_of`, each (m,) of complete people."""
        each = [numbers_of(scan) for scan in self.results(condition)]
        return {name: np.array([own[name] for own in each], dtype=float) for name in each[0]}

    def history(
        self, condition: str | None = None, of: str | History = "normal", *, steps: int = 201
    ) -> tuple[Array, Array]:
        """Return a history of the complete people on one axis.

        Parameters
        ----------
        condition
            Name of the condition; by default the first.
        of
            ``normal`` or ``tangential`` for a force, in N or N/mm; ``central_sed_kPa``, of the
            receptor nearest to X = Y = 0; another column of `Results.trace` with one number for
            each step; or a function of a scan that returns one for each step of its trace.
        steps
            Number of times.

        Returns
        -------
        time_s
            Evenly spaced, (steps,): from the latest first to the earliest last time of all scans, 0
            at the end of the indentation.
        values
            (m, steps), linear between the steps of each scan.

        Raises
        ------
        StudyError
            There is no such condition or column, or the scans have no time in common.
        """
        scans = self.results(condition)
        values = [of(scan) if callable(of) else history(scan, of) for scan in scans]
        times = [scan.trace["time_s"] for scan in scans]
        start, end = max(t[0] for t in times), min(t[-1] for t in times)
        if start >= end:
            raise StudyError(f"The scans in {self.folder} have no time in common.")
        grid = np.linspace(start, end, steps)
        return grid, np.array([np.interp(grid, *one) for one in zip(times, values, strict=True)])
