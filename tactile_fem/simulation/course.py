"""The displacements after all steps of a scan, from which those of a scan beside it are guessed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mpi4py import MPI

import numpy as np

from tactile_fem.mechanics.state import Array, State

# Times of steps, and ways of the body, that differ by less are the same.
_ROUNDING_S, _ROUNDING_MM = 1e-9, 1e-9


@dataclass(frozen=True)
class Moment:
    """When and where the body is: the piece of the path, the time in it, and the place.

    The latter is its position (3,), mm, and its rotation vector (3,), rad.
    """

    piece: int
    time_s: float
    place: Array


class Course:
    """Displacements after the steps of a scan, on this rank, and those of an earlier one.

    While the body moves as it did in the earlier scan, the displacement changes nearly as it did
    there, so that Newton's method takes two thirds of the iterations. Results differ only by what
    its tolerance leaves. Single precision is enough for a guess.

    Parameters
    ----------
    beside
        The course of an earlier scan of the same finger.
    """

    def __init__(self, beside: Course | None = None) -> None:
        self.beside = beside
        self._points: Array | None = None
        self._pieces: dict[int, _Piece] = {}

    @property
    def is_empty(self) -> bool:
        """Whether no step was stored."""
        return not self._pieces

    def note(self, begin: Moment, end: Moment, state: State, iterations: int) -> None:
        """Store the step that was accepted."""
        if self._points is None:
            self._points = state.u.function_space.tabulate_dof_coordinates()
        if end.piece not in self._pieces:
            self._pieces[end.piece] = _Piece()
            self._pieces[end.piece].note(begin, state.u_before.x.array, 0)
        self._pieces[end.piece].note(end, state.u_old.x.array, iterations)

    def way(self, begin: Moment, end: Moment, state: State) -> Array | None:
        """Return the change of the displacement in the earlier scan, as this rank's array.

        None if the body did not move in this way there; all ranks call.
        """
        if self.beside is None or begin.piece not in self.beside._pieces:
            return None
        if not self.beside._is_of(state):
            self.beside = None
            return None
        return self.beside._pieces[begin.piece].way(begin, end)

    def iterations(self, end: Moment) -> int:
        """Return the iterations of the step of the earlier scan to a time; 0 if it is not known."""
        if self.beside is None or end.piece not in self.beside._pieces:
            return 0
        return self.beside._pieces[end.piece].iterations_to(end.time_s)

    def _is_of(self, state: State) -> bool:
        """Return whether displacements are numbered as those of a state, on all ranks."""
        points = state.u.function_space.tabulate_dof_coordinates()
        same = self._points is not None and np.array_equal(points, self._points)
        return bool(state.u.function_space.mesh.comm.allreduce(same, MPI.LAND))


@dataclass
class _Piece:
    """Steps of a piece of the path."""

    times_s: list[float] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)
    u: list[Array] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)

    def note(self, moment: Moment, u: Array, iterations: int) -> None:
        self.times_s.append(moment.time_s)
        self.places.append(moment.place)
        self.u.append(u.astype(np.float32))
        self.iterations.append(iterations)

    def way(self, begin: Moment, end: Moment) -> Array | None:
        first, last = self.times_s[0] - _ROUNDING_S, self.times_s[-1] + _ROUNDING_S
        if begin.time_s < first or end.time_s > last:
            return None
        times_s = begin.time_s, end.time_s
        moved = self._change(self.places, *times_s)
        if np.abs(moved - (end.place - begin.place)).max() > _ROUNDING_MM:
            return None
        return self._change(self.u, *times_s)

    def _change(self, values: Sequence[Array], begin_s: float, end_s: float) -> Array:
        return self._at(values, end_s) - self._at(values, begin_s)

    def _at(self, values: Sequence[Array], time_s: float) -> Array:
        """Return values at a time, linear between steps."""
        k = self._step_to(time_s)
        begin, end = self.times_s[k - 1 : k + 1]
        share = (time_s - begin) / (end - begin)
        return values[k - 1] + share * (values[k].astype(float) - values[k - 1])

    def iterations_to(self, time_s: float) -> int:
        return self.iterations[self._step_to(time_s)]

    def _step_to(self, time_s: float) -> int:
        k = int(np.searchsorted(self.times_s, time_s - _ROUNDING_S))
        return min(max(k, 1), len(self.times_s) - 1)
