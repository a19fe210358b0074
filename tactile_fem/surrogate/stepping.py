"""The steps of a surrogate along a path, and the trace that they make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from tactile_fem import Motion, Path, Trace
from tactile_fem.errors import ConvergenceError, StudyError
from tactile_fem.path import NORMAL
from tactile_fem.results import OF_STEP
from tactile_fem.simulation import TOLERANCE
from tactile_fem.study import DEFAULT_NAME

Array = NDArray[Any]

_LONGEST_MM, _LONGEST_S = 0.1, 0.05


@dataclass(frozen=True)
class BodyState:
    """What a finger feels at one time, of each body.

    Attributes
    ----------
    force_N
        Force of the body on the finger, (bodies, 3).
    contact_area_mm2
        (bodies,).
    felt
        The columns of every trace by name, such as ``sed_kPa``, (bodies, receptors, ...).
    is_outside
        Whether a motion, load or pressure lies beyond those that the finger was made from, or the
        body slides across rather than along, or lies deepest off the pad, (bodies,).
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


def along(path: Path, loop: Any) -> Iterator[tuple[Row, BodyState]]:
    """Step a finger along a path, no step longer than 0.1 mm or 0.05 s; yield what is felt.

    A press to a force is that of the first body. Raises StudyError if the path begins turned, or a
    piece turns the body or holds a force, and ConvergenceError if a force is not met.
    """
    if np.any(path.start_rad):
        raise StudyError("protocol: a fast finger knows no turns, but its path begins turned.")
    place, clock, slid, indenting = np.asarray(path.start_mm, dtype=float), 0.0, 0.0, True
    normal_N = 0.0
    for piece in path.pieces:
        motion = piece(place)
        if motion.turn is not None or motion.held is not None:
            raise StudyError(
                f"protocol: a fast finger knows no turns and holds no forces, but its path has a "
                f"{motion.phase} that does."
            )
        indenting, before, wanted = indenting and motion.indents, 0.0, motion.until_N
        for t in _times(motion):
            if wanted is not None:
                if normal_N >= wanted * (1 - TOLERANCE):
                    break
                t = _end_of_press(motion, before, t, normal_N, wanted, loop)
            place = np.asarray(motion.place(t), dtype=float)
            way = 0.0 if indenting else slid + motion.slid_mm(t)
            state = loop.step(place, t - before)
            normal_N = float(state.force_N[0, NORMAL])
            yield Row(clock + t, t - before, motion.phase, way, place, indenting), state
            before = t
        if wanted is not None and before and abs(normal_N - wanted) > TOLERANCE * wanted:
            raise _not_met(motion.phase, place, normal_N, wanted)
        clock += before
        slid += 0.0 if indenting else motion.slid_mm(before)


def _end_of_press(
    motion: Motion, before: float, t: float, normal_N: float, wanted_N: float, loop: Any
) -> float:
    """Return a time, or an earlier one since the last at which the wanted force is met."""

    def excess_N(time: float) -> float:
        normal = normal_N
        if time > before:
            normal = float(loop.ahead(motion.place(time), time - before).force_N[0, NORMAL])
        # A little more is met as well, so that no press ends short of its force.
        excess = normal - wanted_N * (1 + TOLERANCE / 2)
        return 0.0 if abs(excess) < TOLERANCE * wanted_N / 2 else excess

    if excess_N(t) <= 0:
        return t
    shortest = 1e-9 * t
    return max(before + shortest, float(brentq(excess_N, before, t, xtol=shortest)))


def _not_met(phase: str, place: Array, normal_N: float, wanted_N: float) -> ConvergenceError:
    """Return the error of a press that ends at another force, in the words of a scan."""
    if normal_N < wanted_N:
        how, ends, advice = "reached", " at the deepest position that is allowed", "smaller"
    else:
        how, ends, advice = "met", ", to which it jumps", "larger"
    reason = f"the force is not {how}: {normal_N:.3g} of {wanted_N:.3g} N{ends}"
    where = f"the {phase} stopped at a depth of {place[2]:.4f} mm"
    return ConvergenceError(f"{where} ({reason}); try a {advice} force", place, reason)


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
    steps: Sequence[tuple[Row, BodyState]],
    body: int,
    receptors_mm: Array,
    path: Path,
    errors: Mapping[str, float],
) -> Trace:
    """Return the trace of one body, with errors; the first row is the finger at rest."""
    rows, states = zip(*steps, strict=True)
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
    for name in ("force_N", "contact_area_mm2", "is_outside"):
        columns[name] = np.array([getattr(state, name)[body] for state in states], dtype=float)
    for name in states[0].felt:
        columns[name] = np.array([state.felt[name][body] for state in states])
    scales = {
        "force_error_N": ("normal_force", columns["force_N"][:, NORMAL]),
        "sed_error_kPa": ("sed_rms", columns["sed_kPa"].max(initial=0.0)),
        "rate_error": ("rate_", 1.0),
        "mean_rate_error": ("mean_rate_", 1.0),
    }
    for name, (error, scale) in scales.items():
        if found := [share for own, share in errors.items() if own.startswith(error)]:
            columns[name] = np.where(columns["is_outside"] > 0, np.nan, max(found) * scale)
    indented = max((row.clock_s for row in rows if row.is_indenting), default=0.0)
    rest = Trace(receptors_mm, np.full(len(receptors_mm), DEFAULT_NAME), path.start_mm).arrays()
    saved = {
        name: np.concatenate([rest.get(name, np.zeros((1, *values.shape[1:]))), values])
        for name, values in columns.items()
    }
    saved["phase"] = np.concatenate([rest["phase"], [row.phase for row in rows]])
    saved |= {name: rest[name] for name in ("receptors_mm", "population", "directions")}
    return Trace.read({**saved, "time_s": saved["clock_s"] - indented})
