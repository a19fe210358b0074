"""Outlines of regular patterns: ridges of a grating, dots of an array."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely

from tactile_fem.stimulus.body import Array, Distance, norm_of


@dataclass(frozen=True)
class Row:
    """`count` equally spaced positions along an axis, the first at `first` mm."""

    first: float
    spacing: float
    count: int

    @classmethod
    def of(cls, spacing: float, count: int, start: float | None = None) -> Row:
        """Return positions such that `start` mm from the first is 0; default the middle."""
        return cls(-spacing * (count - 1) / 2 if start is None else -start, spacing, count)

    def places(self) -> Array:
        """Return all positions (count,)."""
        return self.first + self.spacing * np.arange(self.count)

    def nearest(self, coordinate: Array) -> Array:
        """Return the position nearest to each coordinate."""
        index = np.round((coordinate - self.first) / self.spacing)
        return self.first + self.spacing * np.clip(index, 0, self.count - 1)


@dataclass(frozen=True)
class Ridges:
    """Parallel ridges, endless along the other axis; `across` is the axis of their `row`."""

    width: float
    row: Row
    across: int

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        offset = xy[:, self.across] - self.row.nearest(xy[:, self.across])
        gradient = np.zeros_like(xy)
        gradient[:, self.across] = np.where(offset < 0, -1.0, 1.0)
        return Distance(np.abs(offset) - self.width / 2, gradient, np.zeros((len(xy), 2, 2)))

    def polygons(self) -> list[shapely.Polygon]:
        """Return the ridges, cut to 20 mm, as polygons."""
        boxes = []
        for place in self.row.places():
            low, high = np.full(2, -10.0), np.full(2, 10.0)
            low[self.across], high[self.across] = place - self.width / 2, place + self.width / 2
            boxes.append(shapely.box(*low, *high))
        return boxes


@dataclass(frozen=True)
class Discs:
    """A rectangular array of discs, their centres at `x` and `y`."""

    radius: float
    x: Row
    y: Row

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        centre = np.column_stack([self.x.nearest(xy[:, 0]), self.y.nearest(xy[:, 1])])
        r, n, H = norm_of(xy - centre)
        return Distance(r - self.radius, n, H)

    def polygons(self) -> list[shapely.Polygon]:
        """Return the discs as polygons."""
        centres = product(self.x.places(), self.y.places())
        return [shapely.Point(centre).buffer(self.radius) for centre in centres]
