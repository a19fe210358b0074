"""Pieces of the path that go straight or stay, and the vibration that they may carry."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tactile_fem.errors import StudyError
from tactile_fem.path.loads import HeldLoads
from tactile_fem.path.motion import Array, Motion, multiples, straight
from tactile_fem.runtime.settings import Finite, Kind, Positive, Settings

_STEPS_PER_PERIOD = 24
Speed = Annotated[Positive, Field(description="speed of the body")]
_OUTPUT_SHARE = 0.1  # of a hold, between two outputs
HELD = "normal force to be held by moving in Z; not set: the depth is held"
_VIBRATES = "small vibration of the body on top: frequency_Hz, amplitude_mm, direction"


class Piece(Kind):
    """Base class of pieces of the path: their keys and motion."""

    former = MappingProxyType(dict.fromkeys(("first_place", "first_turn"), "define first_pose"))

    def motion(self, start_mm: Array) -> Motion:
        """Return the motion from where the body is when the piece begins, (3,) in mm."""
        raise StudyError(
            f'protocol.path: kind = "{self.kind}" is known where its module is imported'
        )

    def __call__(self, start_mm: Array) -> Motion:
        """Return the motion; so a `Path` takes pieces and functions alike."""
        return self.motion(start_mm)

    def first_pose(self) -> tuple[Array, Array]:
        """Return the pose of the body, mm and rad, at the start if this is the first piece."""
        return np.zeros(3), np.zeros(3)

    def resolved(self, deepest_mm: float) -> Piece:
        """Return the piece with what its keys leave open, such as the content of a file.

        A press to a force is given up at `deepest_mm`.
        """
        return self


class Vibration(Settings):
    """A vibration of the body on top of a piece of the path; for inertia see `Solver`."""

    frequency_Hz: Positive = Field(description="of the vibration, which begins at its mean")
    amplitude_mm: Positive = Field(description="from its mean to its extreme")
    direction: tuple[Finite, Finite, Finite] = Field(
        (0.0, 0.0, 1.0), description="X, Y and Z; its length has no effect"
    )

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Self:
        if not any(self.direction):
            raise ValueError("direction = [0, 0, 0] is none")
        return self

    def added_to(self, base: Motion) -> Motion:
        """Return a motion with the vibration on top; its outputs and steps follow the wave.

        Between 24 places in each period the body moves straight.

        Raises
        ------
        StudyError
            It holds a force by moving in Z, and the vibration has a part along Z.
        """
        along = np.asarray(self.direction, dtype=float)
        swing = self.amplitude_mm * along / np.linalg.norm(along)
        if base.held is not None and swing[2]:
            raise StudyError(
                f"protocol: a {base.phase} holds a force of {base.held_at_end()[-1]:g} by moving "
                f"in Z, so its vibration cannot have the direction {along.tolist()}: let it "
                "vibrate in X and Y, or hold the depth."
            )

        def place(t: float) -> Array:
            return base.place(t) + np.sin(2 * np.pi * self.frequency_Hz * t) * swing

        times = multiples(1 / self.frequency_Hz / _STEPS_PER_PERIOD, base.duration_s)
        outputs = np.union1d(np.round(times, 12), np.round(base.outputs_s, 12))
        inside = outputs[outputs < base.duration_s * (1 - 1e-9)]
        knots = np.array([0.0, *inside, base.duration_s])
        return replace(base, place=place, outputs_s=knots[1:], knots_s=knots)


def held_normal(force_N: float | None) -> HeldLoads | None:
    """Return a normal force to be held, None if there is none."""
    return None if force_N is None else HeldLoads.normal(force_N)


class Press(Piece):
    """Press into the pad to a depth, or to a force."""

    kind: Literal["press"] = "press"
    depth_mm: Positive | None = Field(
        None, description="where it ends: indentation of the undeformed pad's lowest point"
    )
    force_N: Positive | None = Field(
        None, description="normal force that ends it, instead of depth_mm"
    )
    speed_mm_s: Speed = 20.0
    direction: tuple[Finite, Finite, Positive] = Field(
        (0.0, 0.0, 1.0), description="X, Y and Z (above 0); its length has no effect"
    )

    @model_validator(mode="after")
    def _has_one_end(self) -> Self:
        if (self.depth_mm is None) == (self.force_N is None):
            raise ValueError("a press needs depth_mm or force_N, one of the two")
        return self

    def resolved(self, deepest_mm: float) -> Press:
        """Return a press to a force that also has the depth at which it is given up."""
        return self if self.depth_mm else self.model_copy(update={"depth_mm": deepest_mm})

    def motion(self, start_mm: Array) -> Motion:
        """Return a straight press; one to a force must be `resolved`."""
        if self.depth_mm is None:
            raise ValueError("a press to a force needs the depth at which it is given up")
        x, y, z = self.direction
        way = (self.depth_mm - start_mm[2]) * np.array([x / z, y / z, 1.0])
        return straight("press", start_mm, start_mm + way, self.speed_mm_s, until_N=self.force_N)


class Hold(Piece):
    """Hold the body still, or at a force."""

    kind: Literal["hold"] = "hold"
    time_s: Positive = Field(description="duration")
    output_s: Positive | None = Field(
        None, description="time between two outputs; not set: a tenth of time_s"
    )
    force_N: Positive | None = Field(None, description=HELD)
    vibration: Vibration | None = Field(None, description=_VIBRATES)

    def motion(self, start_mm: Array) -> Motion:
        """Return a stay, at the depth or at a held normal force."""
        outputs = multiples(self.output_s or _OUTPUT_SHARE * self.time_s, self.time_s)
        knots = np.array([0.0, self.time_s])
        held = held_normal(self.force_N)
        base = Motion("hold", self.time_s, lambda t: start_mm, outputs, knots, held=held)
        return self.vibration.added_to(base) if self.vibration else base


class Slide(Piece):
    """Slide across the pad."""

    kind: Literal["slide"] = "slide"
    by_mm: tuple[Finite, Finite] = Field(
        (0.0, -10.0), description="how far across (X) and along (Y; towards the palm is negative)"
    )
    speed_mm_s: Speed = 20.0
    output_mm: Positive = Field(0.1, description="distance between outputs")
    force_N: Positive | None = Field(None, description=HELD)
    vibration: Vibration | None = Field(None, description=_VIBRATES)

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if not any(self.by_mm):
            raise ValueError("by_mm = [0, 0] is no slide: use a hold")
        return self

    def motion(self, start_mm: Array) -> Motion:
        """Return a slide at a held depth or normal force."""
        by, speed = np.array([*self.by_mm, 0.0]), self.speed_mm_s
        outputs = multiples(self.output_mm, float(np.linalg.norm(by))) / speed
        base = straight(
            "slide", start_mm, start_mm + by, speed, outputs, held=held_normal(self.force_N)
        )
        return self.vibration.added_to(base) if self.vibration else base


class Lift(Piece):
    """Lift the body off."""

    kind: Literal["lift"] = "lift"
    depth_mm: Finite = Field(
        0.0, description="where it ends: at 0 the body touches the undeformed pad, below 0 not"
    )
    speed_mm_s: Speed = 20.0

    def motion(self, start_mm: Array) -> Motion:
        """Return a straight lift."""
        end = np.array([start_mm[0], start_mm[1], self.depth_mm])
        return straight("lift", start_mm, end, self.speed_mm_s)
