"""Pieces of the path that turn the body: about Z, X or Y."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tactile_fem.path.motion import Array, Motion, multiples
from tactile_fem.path.pieces import HELD, Piece, held_normal
from tactile_fem.path.rotations import matrix
from tactile_fem.runtime.settings import Finite, Positive


class _Turn(Piece):
    """Turn about an axis through a point."""

    angle_deg: Annotated[Finite, Field(ge=-360, le=360)] = Field(
        description="angle, counterclockwise as seen from the end of the axis"
    )
    speed_deg_s: Positive = Field(20.0, description="speed of the turn")
    about_mm: tuple[Finite, Finite, Finite] = Field(
        (0.0, 0.0, 0.0),
        description="point on the axis: X and Y of the finger, and its height above the top of "
        "the body",
    )
    output_deg: Positive = Field(1.0, description="angle between outputs")
    force_N: Positive | None = Field(None, description=HELD)

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if not self.angle_deg:
            raise ValueError("angle_deg = 0 is no turn: use a hold")
        return self

    def _about(self, axis: int, start_mm: Array) -> Motion:
        """Return the turn about an axis of the finger, at a held depth or normal force."""
        end_s = abs(self.angle_deg) / self.speed_deg_s
        unit = np.radians(self.angle_deg) * np.eye(3)[axis]
        point = np.array([*self.about_mm[:2], start_mm[2] + self.about_mm[2]])

        def turn(t: float) -> Array:
            return unit * (t / end_s)

        def place(t: float) -> Array:
            return start_mm + (matrix(turn(t)) - np.eye(3)) @ (start_mm - point)

        outputs = multiples(self.output_deg, abs(self.angle_deg)) / self.speed_deg_s
        held = held_normal(self.force_N)
        return Motion(self.kind, end_s, place, outputs, held=held, turn=turn)


class Twist(_Turn):
    """Twist the body on the skin, about Z."""

    kind: Literal["twist"] = "twist"

    def motion(self, start_mm: Array) -> Motion:
        """Return a turn about Z."""
        return self._about(2, start_mm)


class Roll(_Turn):
    """Roll the body over the skin, about X or Y."""

    kind: Literal["roll"] = "roll"
    axis: Literal["x", "y"] = Field("x", description="across or along the finger")

    def motion(self, start_mm: Array) -> Motion:
        """Return a turn about the axis."""
        return self._about("xy".index(self.axis), start_mm)
