"""Where the body is at each time: motions, and the path that they form."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.path.loads import COMPONENTS, HeldLoads
from tactile_fem.path.rotations import ARM_MM, turned

Array = NDArray[np.float64]

# Number of times at which a motion without knots is sampled.
_SAMPLES = 2001
MAX_OUTPUTS = 100_000
_MAX_PATH_S = 100_000.0
_JOINT_TOLERANCE_MM = _JOINT_TOLERANCE_RAD = 1e-6
# A press to a force is planned to end at this share of its way: another may go deeper from there.
_PLAN_SHARE = 0.9


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
    held
        Loads that are held by moving the body; the parts of `place` and `turn` along them have no
        effect.
    turn
        Rotation vector in rad, (3,), of the body about its own origin, in the axes of space, since
        the piece began, likewise; None if it does not turn.
    """

    phase: str
    duration_s: float
    place: Callable[[float], Array]
    outputs_s: Sequence[float] | Array = ()
    knots_s: Array | None = None
    until_N: float | None = None
    held: HeldLoads | None = None
    turn: Callable[[float], Array] | None = None

    @cached_property
    def times_s(self) -> Array:
        """Times of the knots since the piece began, (knots,)."""
        if self.knots_s is None:
            return np.linspace(0.0, self.duration_s, _SAMPLES)
        return self.knots_s

    @cached_property
    def places_mm(self) -> Array:
        """Positions at the knots, between which the body moves straight, (knots, 3)."""
        return self._at_knots(self.place, "place")

    @cached_property
    def turns_rad(self) -> Array:
        """Rotation vectors at the knots since the piece began, (knots, 3)."""
        if self.turn is None:
            return np.zeros_like(self.places_mm)
        return self._at_knots(self.turn, "turn")

    def _at_knots(self, of: Callable[[float], Array], name: str) -> Array:
        found = np.array([of(float(t)) for t in self.times_s])
        if found.shape != (len(self.times_s), 3) or not np.isfinite(found).all():
            raise StudyError(
                f"protocol: a {name} on its path ({self.phase}) is not three finite numbers."
            )
        return found

    @cached_property
    def _travel(self) -> Array:
        """Times, s, and lengths of path up to them, mm, (4, knots).

        Across the finger; the same and in Z, each with the way of skin that a turn carries along.
        """
        moves = np.abs(np.diff(self.places_mm, axis=0))
        turns = ARM_MM * np.abs(np.diff(self.turns_rad, axis=0))
        slid = np.hypot(moves[:, 0], moves[:, 1])
        lengths = slid, slid + turns[:, 2], moves[:, 2] + np.hypot(turns[:, 0], turns[:, 1])
        return np.array([self.times_s, *(np.append(0.0, np.cumsum(length)) for length in lengths)])

    def slid_mm(self, time_s: float) -> float:
        """Return the length of the path across the finger, in X and Y, up to a time."""
        times, slid, *_ = self._travel
        return float(np.interp(time_s, times, slid))

    def time_within(self, time_s: float, across_mm: float, up_mm: float) -> float:
        """Return how long the body moves, from a time on, before it exceeds a length of path.

        The lengths are those across the finger and in Z; at the latest the piece ends.
        """
        times, _, *travel = self._travel
        ends = [self.duration_s]
        for lengths, longest in zip(travel, (across_mm, up_mm), strict=True):
            limit = np.interp(time_s, times, lengths) + longest
            k = int(np.searchsorted(lengths, limit, side="right"))
            if k < len(lengths):
                share = (limit - lengths[k - 1]) / (lengths[k] - lengths[k - 1])
                ends.append(times[k - 1] + share * (times[k] - times[k - 1]))
        return float(min(ends) - time_s)

    def least_steps(self, across_mm: float, up_mm: float) -> float:
        """Return how many steps it takes if none is longer than `across_mm` or `up_mm`."""
        *_, across, up = self._travel[:, -1]
        return max(1.0, len(self.outputs_s), float(across / across_mm), float(up / up_mm))

    @property
    def fastest_mm_s(self) -> float:
        """The body's highest speed, also of skin that a turn carries along."""
        times, _, across, up = self._travel
        return float((np.hypot(np.diff(across), np.diff(up)) / np.diff(times)).max())

    @property
    def indents(self) -> bool:
        """Whether it presses the body straight into the finger."""
        goes_in = self.place(self.duration_s)[2] > self.place(0.0)[2]
        is_straight = self.turn is None and self.slid_mm(self.duration_s) == 0
        return self.held is None and is_straight and bool(goes_in)

    def held_at_end(self) -> Array:
        """Return the held loads at its end if it begins without one, (components,)."""
        if self.held is None:
            return np.zeros(0)
        loads = self.held.at(self.duration_s, np.zeros(len(COMPONENTS)))
        return loads[list(self.held.components)]

    def check(self, name: str, start_mm: Array) -> None:
        """Raise StudyError, which begins with a name, if it is not valid or begins elsewhere."""
        end_s = self.duration_s
        if not (math.isfinite(end_s) and end_s > 0):
            raise StudyError(f"{name} takes {end_s:g} s but must take a finite time above 0 s.")
        outputs = np.asarray(self.outputs_s, dtype=float)
        if len(outputs) > MAX_OUTPUTS:
            raise StudyError(
                f"{name} has an output every {outputs[0]:.3g} s, more than {MAX_OUTPUTS:,} in all: "
                "raise output_mm or output_s."
            )
        inside = (outputs > 0).all() and (outputs <= end_s * (1 + 1e-9)).all()
        if not inside or (np.diff(outputs) <= 0).any():
            raise StudyError(
                f"{name}: its outputs_s must increase from above 0 to at most {end_s:g} s."
            )
        knots = np.asarray([0.0, end_s] if self.knots_s is None else self.knots_s)
        if knots[0] != 0 or knots[-1] != end_s or (np.diff(knots) <= 0).any():
            raise StudyError(f"{name}: its knots_s must increase from 0 to {end_s:g} s.")
        distance = float(np.abs(self.places_mm[0] - start_mm).max())
        if not distance <= _JOINT_TOLERANCE_MM:
            x, y, z = start_mm
            raise StudyError(
                f"{name} begins {distance:.3g} mm from where the body is then; its first place "
                f"must be X {x:g}, Y {y:g}, Z {z:g} mm."
            )
        angle_rad = float(np.linalg.norm(self.turns_rad[0]))
        if not angle_rad <= _JOINT_TOLERANCE_RAD:
            raise StudyError(
                f"{name} begins turned by {math.degrees(angle_rad):.3g} degrees from where the "
                "body is then; its first turn must be 0."
            )


# From the position (3,) in mm at which a piece begins to its motion.
MotionFrom = Callable[[Array], Motion]


@dataclass(frozen=True)
class Path:
    """Pieces of motion in order.

    The first pieces that press the body straight in are the indentation. Time 0 is its end, or the
    start of a path without one.

    Parameters
    ----------
    pieces
        At least one: kinds of `Piece`, or functions from the position (3,) in mm at which the
        piece begins, known only when a press to a force has ended, to its motion.
    start_mm, start_rad
        Pose of the body at the start: place, (3,), and rotation vector, (3,).
    """

    pieces: tuple[MotionFrom, ...]
    start_mm: Array = field(default_factory=lambda: np.zeros(3))
    start_rad: Array = field(default_factory=lambda: np.zeros(3))

    def plan(self) -> Iterator[tuple[Array, Motion]]:
        """Yield the start of each piece and its motion, as far as they are known before the scan.

        A press to a force is assumed to end shortly before its deepest position.
        """
        place = np.asarray(self.start_mm, dtype=float)
        for piece in self.pieces:
            motion = piece(place)
            yield place, motion
            share = 1.0 if motion.until_N is None else _PLAN_SHARE
            place = motion.place(share * motion.duration_s)

    def places_mm(self) -> Array:
        """Return positions along the whole plan, (n, 3)."""
        return np.concatenate([motion.places_mm for _, motion in self.plan()])

    def turns_rad(self) -> Array:
        """Return the body's rotation vectors there, (n, 3)."""
        found, start = [], np.asarray(self.start_rad, dtype=float)
        for _, motion in self.plan():
            found.append(np.array([turned(start, turn) for turn in motion.turns_rad]))
            start = found[-1][-1]
        return np.concatenate(found)

    def announce(self) -> None:
        """Log what its pieces say of their files."""
        for piece in self.pieces:
            getattr(piece, "announce", lambda: None)()

    def check(self) -> None:
        """Raise StudyError if the path is not valid."""
        total_s = 0.0
        for number, (start, motion) in enumerate(self.plan(), 1):
            motion.check(f"protocol: piece {number} of its path ({motion.phase})", start)
            total_s += motion.duration_s
        if total_s > _MAX_PATH_S:
            raise StudyError(
                f"protocol: its path lasts {total_s:g} s but may last {_MAX_PATH_S:,.0f} s at "
                "most: shorten it or raise its speeds."
            )


def straight(
    phase: str,
    start_mm: Array,
    end_mm: Array,
    speed_mm_s: float,
    outputs_s: Sequence[float] | Array = (),
    *,
    until_N: float | None = None,
    held: HeldLoads | None = None,
) -> Motion:
    """Return a motion from one place to another at constant speed."""
    way = np.subtract(end_mm, start_mm)
    duration = float(np.linalg.norm(way)) / speed_mm_s

    def place(t: float) -> Array:
        return start_mm + (t / duration) * way

    knots = np.array([0.0, duration])
    return Motion(phase, duration, place, outputs_s, knots, until_N, held)


def multiples(step: float, end: float) -> Array:
    """Return the multiples of a step up to an end: at most one more than the allowed outputs."""
    count = int(min(end / step + 1e-9, MAX_OUTPUTS + 1))
    return np.multiply(step, np.arange(1, count + 1), dtype=np.float64)
