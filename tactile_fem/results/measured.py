"""Compares a scan with a recording: with what the path did not take from it as input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.path import Follow, Path
from tactile_fem.path.recording import COLUMNS, LOADS, PLACES, TURNS, Frame, Recording
from tactile_fem.path.rotations import between, moment_about, since_first
from tactile_fem.study import Study

Array = NDArray[np.float64]

_KEY = "output.measured"
_FREED = dict(zip(LOADS, (*PLACES, TURNS[2]), strict=True))  # by a force or torque that is held
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Compared:
    """A column of a recording and what the model gave at the same times, all (n,).

    They are in the finger's axes: places and turns of the body since the first row, and forces on
    the finger, not smoothed. `time_s` is that of the trace.
    """

    name: str
    time_s: Array
    recorded: Array
    model: Array

    @property
    def rms(self) -> float:
        """Root mean square of the differences in the rows, in the column's unit."""
        return float(np.sqrt(np.mean((self.model - self.recorded) ** 2)))

    @property
    def share(self) -> float:
        """`rms` as a share of the recorded range; NaN if all recorded values are equal."""
        width = np.ptp(self.recorded)
        return self.rms / float(width) if width else np.nan

    @property
    def r(self) -> float:
        """Pearson's correlation coefficient; NaN if all values of one of the two are equal."""
        varies = np.ptp(self.recorded) and np.ptp(self.model)
        return float(np.corrcoef(self.recorded, self.model)[0, 1]) if varies else np.nan

    @property
    def summary(self) -> str:
        """The three numbers, as far as they are defined, and a doubt of the sign."""
        words = [f"rms difference {self.rms:.3g} {self.name.partition('_')[2]}"]
        words += [f"{self.share:.1%} of range"] if np.isfinite(self.share) else []
        words += [f"r = {self.r:.3f}"] if np.isfinite(self.r) else []
        words += ["sign reversed?"] if self.r < -0.5 else []
        return ", ".join(words)


def check_measured(study: Study, path: Path) -> None:
    """Raise StudyError if a scan along a path cannot be compared with the study's recording."""
    file = study.output.measured
    if study.output.measured_frame and (file is None or _followed(study)):
        raise StudyError(f"{_KEY}_frame is only for a file in {_KEY} that no piece follows.")
    if file is None:
        return
    recorded, zero_s = _read(study, file)
    if not _free(study, recorded):
        raise StudyError(
            f"{_KEY}: the path takes every column of {file} as input, so none can be compared."
        )
    lasts_s, path_s = recorded.time_s[-1] - zero_s, sum(one.duration_s for _, one in path.plan())
    if not _followed(study) and lasts_s > path_s * (1 + _ROUNDING):
        raise StudyError(f"{_KEY}: {file} lasts {lasts_s:.4g} s but the path {path_s:.4g} s.")


def compare(study: Study, trace: Mapping[str, NDArray[Any]]) -> list[Compared]:
    """Return what was recorded and what a trace has, as far as it goes, a column each.

    The first row is the start of the first piece that follows the file; else it, or the contact, is
    that of the path. Without a recording, or if the trace ends before two rows, there are none.
    StudyError if the recording cannot be read.
    """
    file = study.output.measured
    if file is None:
        return []
    recorded, zero_s = _read(study, file)
    clock_s, start_s = trace["clock_s"], _start_s(study, trace)
    at_s = recorded.time_s - zero_s + start_s
    rows = (at_s >= start_s - _ROUNDING) & (at_s < clock_s[-1] + _ROUNDING)
    if rows.sum() < 2:
        return []
    there, at_s = _columns(recorded.values[rows], recorded.smooth[rows][0]), at_s[rows]
    time_s = at_s - clock_s[0] + trace["time_s"][0]

    forces, origins = trace["force_N"], trace["stimulator_mm"]
    torque_Nmm = moment_about(origins, forces, trace["moment_Nmm"])[:, 2]
    known = [*origins.T, *forces.T, torque_Nmm]
    x, y, z, *loads = (np.interp(at_s, clock_s, column) for column in known)
    turns = np.degrees(between(trace["stimulator_rad"], clock_s, at_s))
    values = np.column_stack([x, y, z, turns, *loads])
    here = _columns(values, values[0])
    return [Compared(name, time_s, there[name], here[name]) for name in _free(study, recorded)]


def _columns(values: Array, first: Array) -> dict[str, Array]:
    """Return columns (n, 10) by name, places since a first row and turns since their own."""
    turns = np.degrees(since_first(np.radians(values[:, 3:6])))
    values = np.hstack([values[:, :3] - first[:3], turns, values[:, 6:]])
    return dict(zip(COLUMNS, values.T, strict=True))


def _read(study: Study, file: Any) -> tuple[Recording, float]:
    """Return the recording in the body's frame, and the time in it at which its path starts."""
    if followed := _followed(study):
        found = followed[0].recorded  # read and smoothed once
        return found, float(found.time_s[0])
    found = (study.output.measured_frame or Frame()).read(file, _KEY)
    return found, found.contact_s if np.isfinite(found.contact_s) else float(found.time_s[0])


def _followed(study: Study) -> list[Follow]:
    """Return the pieces of the path that follow the recording."""
    pieces = [piece for piece in study.protocol.pieces if isinstance(piece, Follow)]
    return [piece for piece in pieces if piece.file == study.output.measured]


def _free(study: Study, recorded: Recording) -> list[str]:
    """Return the columns that the path does not take as input."""
    given: set[str] = set()
    for piece in _followed(study)[:1]:
        given = {*PLACES, *TURNS, *piece.hold} - {_FREED[load] for load in piece.hold}
    return [name for name in recorded.names if name not in given]


def _start_s(study: Study, trace: Mapping[str, NDArray[Any]]) -> float:
    """Return when the first row was, on the clock of the path.

    When a press to a force has ended only the trace knows. There, pieces that follow files one
    after the other are one phase.
    """
    follows = trace["phase"] == "follow"
    starts_s = trace["clock_s"][np.flatnonzero(follows[1:] & ~follows[:-1])]
    runs = groupby(study.protocol.pieces, lambda piece: isinstance(piece, Follow))
    for start_s, run in zip(starts_s, (list(run) for is_one, run in runs if is_one), strict=False):
        for piece in run:
            if piece in _followed(study):
                return float(start_s)
            start_s += piece.motion(np.zeros(3)).duration_s
    return 0.0
