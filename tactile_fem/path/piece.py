"""A piece of the path, and the vibration that it may carry."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from tactile_fem.errors import StudyError
from tactile_fem.path.motion import Array, Motion, MotionFrom, multiples
from tactile_fem.runtime.settings import Finite, Kind, Positive, Settings

_STEPS_PER_PERIOD = 24


class Piece(Kind):
    """Keys and motion of a piece of the path; each kind is a class of its own below this one."""

    def motion(self, start_mm: Array) -> Motion:
        """Return the motion from where the body is when the piece begins, (3,) in mm."""
        raise StudyError(
            f'protocol.path: kind = "{self.kind}" is known where its module is imported'
        )

    def __call__(self, start_mm: Array) -> Motion:
        """Return the motion; so a `Path` takes pieces and functions alike."""
        return self.motion(start_mm)

    def first_place(self) -> Array:
        """Return where the body starts if this is the first piece, (3,) in mm."""
        return np.zeros(3)

    def resolved(self, deepest_mm: float) -> MotionFrom:
        """Return the piece with what its keys leave open, such as the content of a file.

        A press to a force is given up at `deepest_mm`.
        """
        return self


class Vibration(Settings):
    """A vibration of the body on top of a piece of the path; for inertia see `Solver`."""

    frequency_Hz: Positive = Field(description="of the vibration, which begins at its middle")
    amplitude_mm: Positive = Field(description="from the middle to the end of the swing")
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
        if base.held_N is not None and swing[2]:
            raise StudyError(
                f"protocol: a {base.phase} holds a force of {base.held_N:g} by moving in Z, so its "
                f"vibration cannot have the direction {along.tolist()}: let it vibrate in X and Y, "
                "or hold the depth."
            )

        def place(t: float) -> Array:
            return base.place(t) + np.sin(2 * np.pi * self.frequency_Hz * t) * swing

        times = multiples(1 / self.frequency_Hz / _STEPS_PER_PERIOD, base.duration_s)
        outputs = np.union1d(np.round(times, 12), np.round(base.outputs_s, 12))
        inside = outputs[outputs < base.duration_s * (1 - 1e-9)]
        knots = np.array([0.0, *inside, base.duration_s])
        return replace(base, place=place, outputs_s=knots[1:], knots_s=knots)
