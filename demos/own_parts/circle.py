"""A kind of piece of the path: a circle."""

from typing import Literal

import numpy as np
from pydantic import Field

from tactile_fem import Motion, Piece
from tactile_fem.runtime.settings import Positive


class Circle(Piece):
    """A circle through the place where the piece begins."""

    kind: Literal["circle"] = "circle"
    radius_mm: Positive = Field(1.5, description="of the circle")
    speed_mm_s: Positive = Field(20.0, description="along the circle")

    def motion(self, start_mm):
        """Return the motion from `start_mm`, (3,)."""
        duration_s = 2 * np.pi * self.radius_mm / self.speed_mm_s

        def place(t):
            angle = 2 * np.pi * t / duration_s
            off = np.array([np.sin(angle), 1 - np.cos(angle), 0.0])
            return start_mm + self.radius_mm * off

        outputs_s = np.linspace(0, duration_s, 17)[1:]
        return Motion("circle", duration_s, place, outputs_s)
