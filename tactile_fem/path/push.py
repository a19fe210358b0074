"""A piece that brings the load on the finger to given forces over time."""

from __future__ import annotations

import math
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tactile_fem.path.loads import COMPONENTS, HeldLoads
from tactile_fem.path.motion import Array, Motion, multiples
from tactile_fem.path.pieces import Piece
from tactile_fem.runtime.settings import Finite, Positive

_OUTPUT_SHARE = 0.05  # of the whole, between two outputs


class Push(Piece):
    """Bring forces on the finger to given values, or hold them, by moving the body.

    Along what is not given the body stays where it is.
    """

    kind: Literal["push"] = "push"
    time_s: Positive = Field(description="duration")
    normal_N: Positive | None = Field(None, description="normal force at its end")
    tangential_N: tuple[Finite, Finite] | None = Field(
        None, description="force across (X) and along (Y) the finger at its end"
    )
    torque_Nmm: Finite | None = Field(
        None, description="torque about Z through the body's origin at its end"
    )
    course: Literal["ramp", "half_sine"] = Field(
        "ramp", description="of the forces: linear, or half a sine wave, slow at both ends"
    )
    output_s: Positive | None = Field(
        None, description="time between two outputs; not set: a twentieth of time_s"
    )

    @model_validator(mode="after")
    def _holds_something(self) -> Self:
        if not self._ends:
            raise ValueError("a push needs normal_N, tangential_N or torque_Nmm")
        return self

    @property
    def _ends(self) -> dict[int, float]:
        """Loads at the end by the index of their component."""
        loads = (*(self.tangential_N or (None, None)), self.normal_N, self.torque_Nmm)
        return {k: load for k, load in enumerate(loads) if load is not None}

    def motion(self, start_mm: Array) -> Motion:
        """Return a stay but for what the loads need."""
        end = np.zeros(len(COMPONENTS))
        end[list(self._ends)] = list(self._ends.values())

        def at(t: float, start: Array) -> Array:
            share = t / self.time_s
            if self.course == "half_sine":
                share = (1 - math.cos(math.pi * share)) / 2
            return start + share * (end - start)

        outputs = multiples(self.output_s or _OUTPUT_SHARE * self.time_s, self.time_s)
        knots = np.array([0.0, self.time_s])
        held = HeldLoads(tuple(self._ends), at)
        return Motion("push", self.time_s, lambda t: start_mm, outputs, knots, held=held)
