"""The steps of a surrogate along a path, and the trace that they make."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.settings import DEFAULT_NAME
from tactile_fem.path.motion import Motion, Path
from tactile_fem.simulation.columns import OF_STEP
from tactile_fem.simulation.trace import Trace

Array = NDArray[Any]

_LONGEST_MM, _LONGEST_S = 0.1, 0.05


@dataclass(frozen=True)
class Moment:
    """What a finger feels at one time, of each body.

    Attributes
    ----------
    force_N
        Of the body on the finger, (bodies, 3).
    contact_area_mm2
        (bodies,).
    felt
        The columns of every trace by name, such as ``sed_kPa``, (bodies, receptors, ...).
    is_outside
        Whether a motion, load or pressure lies beyond those that the finger was made from,
        (bodies,).
    """

    force_N: Array
    contact_area_mm2: Array
    felt: dict[str, Array]
    is_outside: NDArray[np.bool_]


class Row(NamedTuple):
    """A step: when and where it ends, and what is felt then."""

    clock_s: float
    dt_s: float
    phase: str
    slid_mm: float
    place_mm: Array
    is_indenting: bool


def along(path: Path, normal_N: Callable[[], float]) -> Iterator[Row]:
    """Yield the steps along a path, none longer than 0.1 mm or 0.05 s.

    `normal_N` returns the normal force of the step before, at which a press to a force ends.

    Raises
    ------
    StudyError
        The path begins turned, or a piece turns the body or holds a force.
    """
    if np.any(path.start_rad):
        raise StudyError("protocol: a fast finger knows no turns, but its path begins turned.")
    place, clock, slid, indenting = np.asarray(path.start_mm, dtype=float), 0.0, 0.0, True
    for piece in path.pieces:
        motion = piece(place)
        if motion.turn is not None or motion.held is not None:
            raise StudyError(
                f"protocol: a fast finger knows no turns and holds no forces, but its path has a "
                f"{motion.phase} that does."
            )
        indenting, before = indenting and motion.indents, 0.0
        for t in _times(motion):
            place = np.asarray(motion.place(t), dtype=float)
            way = 0.0 if indenting else slid + motion.slid_mm(t)
            yield Row(clock + t, t - before, motion.phase, way, place, indenting)
            before = t
            if motion.until_N is not None and normal_N() >= motion.until_N:
                break
        clock += before
        slid += 0.0 if indenting else motion.slid_mm(before)


def _times(motion: Motion) -> list[float]:
    """Return the times of a motion's outputs, and others between them."""
    ends = np.union1d(np.asarray(motion.outputs_s, dtype=float), [motion.duration_s])
    ends = ends[ends > 0]
    ends = ends[np.append(np.diff(ends) > 1e-9, True)]
    times, start = [], 0.0
    for end in ends.tolist():
        length = np.linalg.norm(np.subtract(motion.place(end), motion.place(start)))
        count = max(1, int(np.ceil(max(length / _LONGEST_MM, (end - start) / _LONGEST_S) - 1e-6)))
        times += np.linspace(start, end, count + 1)[1:].tolist()
        start = end
    return times


def trace_of(
    rows: Sequence[Row], moments: Sequence[Moment], body: int, receptors_mm: Array, path: Path
) -> Trace:
    """Return the trace of one body of the moments; the first row is the finger at rest."""
    count = len(rows)
    columns: dict[str, Array] = {
        column.name: np.full((count, *np.shape(column.rest)), np.nan)
        for column in OF_STEP
        if column.name != "phase"
    }
    place = np.array([row.place_mm for row in rows])
    columns |= {
        "clock_s": np.array([row.clock_s for row in rows]),
        "displacement_mm": np.array([row.slid_mm for row in rows]),
        "depth_mm": place[:, 2],
        "stimulator_mm": place,
        "stimulator_rad": np.tile(path.start_rad, (count, 1)),
    }
    columns["force_N"] = np.array([moment.force_N[body] for moment in moments])
    columns["contact_area_mm2"] = np.array([moment.contact_area_mm2[body] for moment in moments])
    columns["is_outside"] = np.array([float(moment.is_outside[body]) for moment in moments])
    for name in moments[0].felt:
        columns[name] = np.array([moment.felt[name][body] for moment in moments])
    indented = max((row.clock_s for row in rows if row.is_indenting), default=0.0)
    rest = Trace(receptors_mm, np.full(len(receptors_mm), DEFAULT_NAME), path.start_mm).arrays()
    saved = {
        name: np.concatenate([rest.get(name, np.zeros((1, *values.shape[1:]))), values])
        for name, values in columns.items()
    }
    saved["phase"] = np.concatenate([rest["phase"], [row.phase for row in rows]])
    saved |= {name: rest[name] for name in ("receptors_mm", "population", "directions")}
    return Trace.read({**saved, "time_s": saved["clock_s"] - indented})
