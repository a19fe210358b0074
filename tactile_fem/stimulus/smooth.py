"""Smooth bodies: a plate, a bar, a ball and a rounded edge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tactile_fem.runtime.settings import Finite, Positive
from tactile_fem.stimulus.body import Array, Ball, Distance, HalfSpace, in_space, norm_of
from tactile_fem.stimulus.stimulus import ACROSS, Stimulus


class Plate(Stimulus):
    """A flat plate."""

    kind: Literal["plate"] = "plate"

    def shape(self) -> HalfSpace:
        """Return everything below z = 0."""
        return HalfSpace()


class Cylinder(Stimulus):
    """A cylindrical bar lying in the horizontal plane."""

    kind: Literal["cylinder"] = "cylinder"
    radius_mm: Positive = Field(1.585, description="half of 3.17 mm, a usual test bar")
    along: Literal["x", "y"] = Field("x", description="axis of the bar: across or along the finger")

    def shape(self) -> Ball:
        """Return a ball in two axes."""
        return Ball(self.radius_mm, (ACROSS[self.along], 2))


class Sphere(Stimulus):
    """A ball."""

    kind: Literal["sphere"] = "sphere"
    radius_mm: Positive = Field(3.0, description="radius of the ball")

    def shape(self) -> Ball:
        """Return the ball."""
        return Ball(self.radius_mm)


class Edge(Stimulus):
    """A wedge with a rounded ridge, for the sharp-edge test."""

    kind: Literal["edge"] = "edge"
    radius_mm: Positive = Field(0.025, description="paper: radius of the ridge")
    angle_deg: Annotated[Finite, Field(gt=0, lt=180)] = Field(60.0, description="opening angle")
    along: Literal["x", "y"] = Field("x", description="the ridge: across or along the finger")

    def shape(self) -> Wedge:
        """Return the wedge."""
        return Wedge(self.radius_mm, math.radians(self.angle_deg), ACROSS[self.along])


@dataclass(frozen=True)
class Wedge:
    """A ridge of opening angle `angle` (rad) whose crest is rounded with `radius` (mm).

    `across` is the horizontal axis over which it rises and falls.
    """

    radius: float
    angle: float
    across: int

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        axes = (self.across, 2)
        offset = points[:, axes].copy()
        offset[:, 1] += self.radius
        r, n, H = norm_of(offset)
        # The flanks' outward normals lean by half the opening angle from the horizontal.
        c, s = np.cos(self.angle / 2), np.sin(self.angle / 2)
        side = np.where(offset[:, 0] < 0, -1.0, 1.0)
        flank_normal = np.column_stack([side * c, np.full(len(points), s)])
        # Beside the crest, where a flank is nearest: below the line along the flank's normal.
        on_flank = offset[:, 1] * c < np.abs(offset[:, 0]) * s
        flank = np.sum(flank_normal * offset, axis=1)
        r = np.where(on_flank, flank, r)
        n = np.where(on_flank[:, None], flank_normal, n)
        H = np.where(on_flank[:, None, None], 0.0, H)
        return in_space(axes, r - self.radius, n, H)
