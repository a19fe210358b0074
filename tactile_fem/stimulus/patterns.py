"""Regular outlines: ridges of a grating, dots of an array."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from tactile_fem.stimulus.body import Array, Planar, norm_of


def _nearest(coordinate: Array, spacing: float, count: int) -> Array:
    """Return the nearest of `count` equally spaced places about 0."""
    first = -(count - 1) / 2
    return spacing * (np.clip(np.round(coordinate / spacing - first), 0, count - 1) + first)


@dataclass(frozen=True)
class Ridges:
    """`count` parallel ridges, endless along the other axis.

    `across` is the axis over which they follow one another.
    """

    width: float
    spacing: float
    count: int
    across: int

    def distance(self, xy: Array) -> Planar:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        offset = xy[:, self.across] - _nearest(xy[:, self.across], self.spacing, self.count)
        gradient = np.zeros_like(xy)
        gradient[:, self.across] = np.where(offset < 0, -1.0, 1.0)
        return Planar(np.abs(offset) - self.width / 2, gradient, np.zeros((len(xy), 2, 2)))

    def polygons(self) -> list[shapely.Polygon]:
        """Return the ridges, cut to 20 mm, as polygons."""
        places = self.spacing * (np.arange(self.count) - (self.count - 1) / 2)
        boxes = []
        for place in places:
            low, high = np.full(2, -10.0), np.full(2, 10.0)
            low[self.across], high[self.across] = place - self.width / 2, place + self.width / 2
            boxes.append(shapely.box(*low, *high))
        return boxes


@dataclass(frozen=True)
class Discs:
    """A rectangular array of discs."""

    radius: float
    spacing: float
    columns: int
    rows: int

    def distance(self, xy: Array) -> Planar:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        counts = (self.columns, self.rows)
        centre = np.column_stack([_nearest(xy[:, k], self.spacing, counts[k]) for k in range(2)])
        r, n, H = norm_of(xy - centre)
        return Planar(r - self.radius, n, H)

    def polygons(self) -> list[shapely.Polygon]:
        """Return the discs as polygons."""
        x = self.spacing * (np.arange(self.columns) - (self.columns - 1) / 2)
        y = self.spacing * (np.arange(self.rows) - (self.rows - 1) / 2)
        return [shapely.Point(a, b).buffer(self.radius) for a in x for b in y]
