"""A kind of stimulus: a ring raised from a plate."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from tactile_fem import Distance, Embossed, Stimulus
from tactile_fem.runtime.settings import Positive
from tactile_fem.stimulus import norm_of


class Ring(Stimulus):
    """A ring raised by 0.6 mm from a plate."""

    kind: Literal["ring"] = "ring"
    radius_mm: Positive = Field(2.0, description="mean radius")
    width_mm: Positive = Field(1.0, description="from edge to edge")

    def shape(self):
        """Return the body, its highest plane at z = 0."""
        return Embossed(Annulus(self.radius_mm, self.width_mm), relief=0.6, fillet=0.3)


@dataclass(frozen=True)
class Annulus:
    """The flat shape that is raised."""

    radius: float
    width: float

    def distance(self, xy):
        """Return the signed distance in the plane at `xy` (n, 2), negative inside."""
        r, n, H = norm_of(xy)
        side = np.where(r < self.radius, -1.0, 1.0)
        gap = np.abs(r - self.radius) - self.width / 2
        return Distance(gap, side[:, None] * n, side[:, None, None] * H)
