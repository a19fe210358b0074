"""The path of the body: its position at each time, in named pieces.

A piece is a function of the position at which it begins, because a press to a force ends where the
force is reached. An own piece is as short as ``lambda start_mm: Motion(...)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array

# Number of times at which a motion without knots is sampled.
_SAMPLES = 2001
_MOST_OUTPUTS = 100_000
_STEPS_OF_PERIOD = 24
_JOINT_MM = 1e-6
_LONGEST_S = 100_000.0
# Share of its way on which a press is assumed to reach its force: another one goes on from there.
_FORCE_REACHED = 0.9


@dataclass(frozen=True)
class Motion:
    """The position of the body during one piece of a path.

    Parameters
    ----------
    phase
        Name of the piece.
    duration_s
        How long it takes.
    place
        Position of the body in mm, (3,), at a time in s since the piece began. At the origin the
        body touches the apex of the undeformed pad; Z points into the finger.
    outputs_s
        Increasing output times since the piece began; its end is always one.
    knots_s
        Times between which the velocity is constant; default: 2001 evenly spaced ones.
    until_N
        Normal force that ends the piece.
    held_N
        Normal force that is held by moving the body in Z; Z of `place` has no effect.
    """

    phase: str
    duration_s: float
    place: Callable[[float], Array]
    outputs_s: Sequence[float] | Array = ()
    knots_s: Array | None = None
    until_N: float | None = None
    held_N: float | None = None

    @cached_property
    def times_s(self) -> Array:
        """Times of the knots since the piece began, (knots,)."""
        if self.knots_s is None:
            return np.linspace(0.0, self.duration_s, _SAMPLES)
        return self.knots_s

    @cached_property
    def places_mm(self) -> Array:
        """Positions at the knots, between which the body moves straight, (knots, 3)."""
        places = np.array([self.place(float(t)) for t in self.times_s])
        if places.shape != (len(self.times_s), 3) or not np.isfinite(places).all():
            raise StudyError(
                f"protocol: a place on its path ({self.phase}) is not three finite numbers."
            )
        return places

    @cached_property
    def _travel(self) -> Array:
        """Times, s, and lengths of path across the finger and in Z up to them, mm, (3, knots)."""
        moves = np.abs(np.diff(self.places_mm, axis=0))
        lengths = np.hypot(moves[:, 0], moves[:, 1]), moves[:, 2]
        return np.array([self.times_s, *(np.append(0.0, np.cumsum(length)) for length in lengths)])

    def slid_mm(self, time_s: float) -> float:
        """Return the length of the path across the finger, in X and Y, up to a time."""
        times, across, _ = self._travel
        return float(np.interp(time_s, times, across))

    def pressed_mm(self, time_s: float) -> float:
        """Return the length of the path in Z up to a time."""
        times, _, up = self._travel
        return float(np.interp(time_s, times, up))

    def time_within(self, time_s: float, across_mm: float, up_mm: float) -> float:
        """Return how long the body takes, from a time on, to go so far across or in Z."""
        times, across, up = self._travel
        ends = [self.duration_s]
        for lengths, most, so_far in (
            (across, across_mm, self.slid_mm(time_s)),
            (up, up_mm, self.pressed_mm(time_s)),
        ):
            beyond = np.flatnonzero(lengths > so_far + most)
            if len(beyond):
                k = beyond[0]
                share = (so_far + most - lengths[k - 1]) / (lengths[k] - lengths[k - 1])
                ends.append(times[k - 1] + share * (times[k] - times[k - 1]))
        return float(min(ends) - time_s)

    def least_steps(self, across_mm: float, up_mm: float) -> float:
        """Return how many steps it takes if none is longer than `across_mm` or `up_mm`."""
        end = self.duration_s
        lengths = self.slid_mm(end) / across_mm, self.pressed_mm(end) / up_mm
        return max(1.0, len(self.outputs_s), *lengths)

    @property
    def fastest_mm_s(self) -> float:
        """The body's highest speed."""
        times, across, up = self._travel
        return float((np.hypot(np.diff(across), np.diff(up)) / np.diff(times)).max())

    @property
    def indents(self) -> bool:
        """Whether it presses the body straight into the finger."""
        goes_in = self.place(self.duration_s)[2] > self.place(0.0)[2]
        return self.held_N is None and self.slid_mm(self.duration_s) == 0 and bool(goes_in)


# From the position (3,), in mm, at which a piece begins to its motion.
Piece = Callable[[Array], Motion]


@dataclass(frozen=True)
class Path:
    """Pieces of motion in order.

    The first pieces that press the body straight in are the indentation. Time 0 is its end, or the
    start of a path without one.

    Parameters
    ----------
    pieces
        At least one.
    start_mm
        Where the body is at the start, (3,).
    """

    pieces: tuple[Piece, ...]
    start_mm: Array = field(default_factory=lambda: np.zeros(3))

    def plan(self) -> Iterator[tuple[Array, Motion]]:
        """Yield the start of each piece and its motion, as far as they are known before the scan.

        A press to a force is assumed to end shortly before its deepest position.
        """
        place = np.asarray(self.start_mm, dtype=float)
        for piece in self.pieces:
            motion = piece(place)
            yield place, motion
            reached = 1.0 if motion.until_N is None else _FORCE_REACHED
            place = motion.place(reached * motion.duration_s)

    def places_mm(self) -> Array:
        """Return positions along the whole plan, (n, 3)."""
        return np.concatenate([motion.places_mm for _, motion in self.plan()])

    def check(self) -> None:
        """Raise StudyError if the path is not valid."""
        lasts_s = 0.0
        for number, (start, motion) in enumerate(self.plan(), 1):
            name = f"protocol: piece {number} of its path ({motion.phase})"
            duration = motion.duration_s
            if not (math.isfinite(duration) and duration > 0):
                raise StudyError(
                    f"{name} takes {duration:g} s but must take a finite time above 0 s."
                )
            _check_outputs(name, np.asarray(motion.outputs_s, dtype=float), duration)
            knots = np.asarray([0.0, duration] if motion.knots_s is None else motion.knots_s)
            if knots[0] != 0 or knots[-1] != duration or (np.diff(knots) <= 0).any():
                raise StudyError(f"{name}: its knots_s must increase from 0 to {duration:g} s.")
            distance = float(np.abs(motion.places_mm[0] - start).max())
            if not distance <= _JOINT_MM:
                x, y, z = start
                raise StudyError(
                    f"{name} begins {distance:.3g} mm from where the body is then; its first place "
                    f"must be X {x:g}, Y {y:g}, Z {z:g} mm."
                )
            lasts_s += duration
        if lasts_s > _LONGEST_S:
            raise StudyError(
                f"protocol: its path lasts {lasts_s:g} s but may last {_LONGEST_S:,.0f} s at most: "
                "shorten it or raise its speeds."
            )


def _check_outputs(name: str, times_s: Array, end_s: float) -> None:
    if len(times_s) > _MOST_OUTPUTS:
        raise StudyError(
            f"{name} has an output every {times_s[0]:.3g} s, more than {_MOST_OUTPUTS:,} in all: "
            "raise output_mm or output_s."
        )
    inside = (times_s > 0).all() and (times_s <= end_s * (1 + 1e-9)).all()
    if not inside or (np.diff(times_s) <= 0).any():
        raise StudyError(
            f"{name}: its outputs_s must increase from above 0 to at most {end_s:g} s."
        )


# --- pieces ------------------------------------------------------------------------------------


def press(depth_mm: float, speed_mm_s: float, *, until_N: float | None = None) -> Piece:
    """Press straight to a depth, or until the normal force is reached on the way there."""

    def motion(start_mm: Array) -> Motion:
        end = np.array([start_mm[0], start_mm[1], depth_mm])
        return straight("press", start_mm, end, speed_mm_s, until_N=until_N)

    return motion


def slide(
    by_mm: ArrayLike, speed_mm_s: float, output_mm: float, *, held_N: float | None = None
) -> Piece:
    """Slide `by_mm` (2,) across the finger, at a held depth or normal force."""
    by = np.append(np.asarray(by_mm, dtype=float), 0.0)
    count = int(min(np.linalg.norm(by) / output_mm + 1e-9, _MOST_OUTPUTS + 1))
    outputs = output_mm * np.arange(1, count + 1) / speed_mm_s

    def motion(start_mm: Array) -> Motion:
        return straight("slide", start_mm, start_mm + by, speed_mm_s, outputs, held_N=held_N)

    return motion


def hold(time_s: float, output_s: float, *, held_N: float | None = None) -> Piece:
    """Stay, at the depth or at a held normal force."""
    outputs = _every(output_s, time_s)

    def motion(start_mm: Array) -> Motion:
        return Motion(
            "hold", time_s, lambda t: start_mm, outputs, np.array([0.0, time_s]), held_N=held_N
        )

    return motion


def lift(depth_mm: float, speed_mm_s: float) -> Piece:
    """Lift straight off to a depth; at 0 the body just touches the undeformed pad."""

    def motion(start_mm: Array) -> Motion:
        end = np.array([start_mm[0], start_mm[1], depth_mm])
        return straight("lift", start_mm, end, speed_mm_s)

    return motion


def follow(times_s: Array, places_mm: Array, output_s: float) -> Piece:
    """Follow places (n, 3) at increasing times (n,) from where the body is, linear in between."""
    times, steps = times_s - times_s[0], places_mm - places_mm[0]
    outputs = _every(output_s, times[-1])

    def motion(start_mm: Array) -> Motion:
        def place(t: float) -> Array:
            return start_mm + [np.interp(t, times, column) for column in steps.T]

        return Motion("follow", float(times[-1]), place, outputs, times)

    return motion


def vibrating(
    piece: Piece, frequency_Hz: float, amplitude_mm: float, direction: ArrayLike
) -> Piece:
    """Let the body vibrate on top of a piece; steps and outputs follow the wave.

    Between 24 places in each period the body moves straight.

    Raises
    ------
    StudyError
        By the piece: it holds a force by moving in Z, and the vibration has a part along Z.
    """
    along = np.asarray(direction, dtype=float)
    swing = amplitude_mm * along / np.linalg.norm(along)
    period_s = 1 / frequency_Hz

    def motion(start_mm: Array) -> Motion:
        base = piece(start_mm)
        if base.held_N is not None and swing[2]:
            raise StudyError(
                f"protocol: a {base.phase} holds a force of {base.held_N:g} by moving in Z, so its "
                f"vibration cannot have the direction {along.tolist()}: let it vibrate in X and Y, "
                "or hold the depth."
            )

        def place(t: float) -> Array:
            return base.place(t) + np.sin(2 * np.pi * frequency_Hz * t) * swing

        times = _every(period_s / _STEPS_OF_PERIOD, base.duration_s)
        outputs = np.union1d(np.round(times, 12), np.round(base.outputs_s, 12))
        inside = outputs[outputs < base.duration_s * (1 - 1e-9)]
        knots = np.array([0.0, *inside, base.duration_s])
        return replace(base, place=place, outputs_s=knots[1:], knots_s=knots)

    return motion


def straight(
    phase: str,
    start_mm: Array,
    end_mm: Array,
    speed_mm_s: float,
    outputs_s: Sequence[float] | Array = (),
    *,
    until_N: float | None = None,
    held_N: float | None = None,
) -> Motion:
    """Return a motion from one place to another at constant speed."""
    way = np.subtract(end_mm, start_mm)
    duration = float(np.linalg.norm(way)) / speed_mm_s

    def place(t: float) -> Array:
        return start_mm + (t / duration) * way

    knots = np.array([0.0, duration])
    return Motion(phase, duration, place, outputs_s, knots, until_N, held_N)


def _every(step_s: float, end_s: float) -> Array:
    count = int(min(end_s / step_s + 1e-9, _MOST_OUTPUTS + 1))
    return step_s * np.arange(1, count + 1)
