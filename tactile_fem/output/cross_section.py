"""The outline of a stimulator as it passes beneath the receptors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tactile_fem.output.section import gap_of
from tactile_fem.path.rotations import between, swept, to_body
from tactile_fem.results.histories import at_time, turns_at
from tactile_fem.results.results import Results
from tactile_fem.stimulus.sampled import height_map
from tactile_fem.stimulus.spline import linear_between

if TYPE_CHECKING:
    from shapely import Geometry

Array = NDArray[np.float64]

# Of the sampled outline: its step, the largest number of samples, and the margin in X and Y around
# the receptors' way over the stimulator.
_STEP_MM, _MOST_SAMPLES, _MARGIN_MM = 0.04, 160_000, (4.0, 1.0)
# Distances beyond this one are not needed.
_FAR_MM = 0.3
# A body that is not rougher has no outline.
_FLAT_MM = 0.005
# Heights are searched at every so many samples in X and in Y.
_COARSER = 4
_PAPER, _EDGE = "#E6E3DC", "#B8B2A4"


@dataclass(frozen=True)
class CrossSectionMap:
    """What is raised of a body: sampled in its frame, positive inside its outline.

    `inside` (x, y) has the samples from `origin_mm` (2,) on, `step_mm` apart. The body goes through
    the places (steps, 2) at the times (steps,), with the rotation vectors (steps, 3) if it turns.
    """

    origin_mm: Array
    step_mm: float
    inside: Array
    time_s: Array
    places_mm: Array
    turns_rad: Array | None = None

    @property
    def x_mm(self) -> Array:
        """X of the samples, (x,)."""
        return self.origin_mm[0] + self.step_mm * np.arange(len(self.inside))

    @classmethod
    def of(cls, results: Results) -> CrossSectionMap:
        """Sample the body of a scan.

        The outline is that of what its kind raises from a plate. For any other body it is the
        contour at half the height of what comes near the finger.
        """
        trace = results.trace
        places = trace["stimulator_mm"] * [1.0, 1.0, 0.0]
        turns = turns_at(trace, trace["time_s"])
        felt = trace["receptors_mm"] * [1.0, 1.0, 0.0]
        ends = swept(felt.min(axis=0), felt.max(axis=0), places, turns)
        low, high = ends[0][:2] - _MARGIN_MM, ends[1][:2] + _MARGIN_MM
        step = max(_STEP_MM, float(np.sqrt(np.prod(high - low) / _MOST_SAMPLES)))
        x, y = (np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))
        shapes = results.study.stimulus.outlines() if results.stimulator is None else []
        inside = _inside(shapes, x, y) if shapes else _half_way_up(results, x, y)
        return cls(low, step, inside, trace["time_s"], places[:, :2], turns)

    def under(self, points_mm: Array, time_s: Array) -> Array:
        """Return what lies beneath points (n, 2) at some times (t,): (n, t), positive inside.

        The points are as high as the body's origin.
        """
        trace = {"time_s": self.time_s, "places_mm": np.pad(self.places_mm, ((0, 0), (0, 1)))}
        turns = None if self.turns_rad is None else between(self.turns_rad, self.time_s, time_s)
        points = np.pad(points_mm, ((0, 0), (0, 1)))
        there = to_body(points, at_time(trace, "places_mm", time_s).T, turns)[..., :2]
        found = linear_between(self.inside, self.origin_mm, self.step_mm, there.reshape(-1, 2))
        return found.reshape(there.shape[:-1]).T


def draw_outline(
    axes: Axes, at: Array, rows_mm: Array, inside: Array, *, colour: str | None = None
) -> None:
    """Draw the outline (rows, columns) over an axis: filled in the colour of paper, or a line."""
    if not (inside.min() < 0 < inside.max()):
        return
    if colour is None:
        axes.contourf(at, rows_mm, inside, [0.0, np.inf], colors=_PAPER, zorder=0.1)
    style = {"colors": colour or _EDGE, "linewidths": 0.7, "zorder": 2 if colour else 0.2}
    axes.contour(at, rows_mm, inside, [0.0], **style)


def _inside(shapes: Sequence[Geometry], x: Array, y: Array) -> Array:
    """Return the distance to the edge of shapes, positive inside, (x, y)."""
    shape = shapely.union_all(shapes)
    points = shapely.points(*np.meshgrid(x, y, indexing="ij"))
    shapely.prepare(shape)
    near = shapely.dwithin(shape.boundary, points, _FAR_MM)
    apart = np.full(points.shape, _FAR_MM)
    apart[near] = shapely.distance(shape.boundary, points[near])
    return np.where(shapely.contains(shape, points), apart, -apart)


def _half_way_up(results: Results, x: Array, y: Array) -> Array:
    """Return the distance into the body at half the height of what comes near the finger."""
    grid = results.stimulator
    if grid is None:
        body = results.study.stimulus.body()
        height = height_map(body, x[::_COARSER], y[::_COARSER])
        gap = gap_of(body)
    else:
        z = grid.origin_mm[2] + grid.step_mm * np.arange(len(grid.gap_mm))
        height = np.where(grid.gap_mm < 0, z[:, None, None], z[0]).max(axis=0)
        gap = grid.gap
    deepest_mm = max(float(results.trace["depth_mm"].max()), 0.0)
    highest = float(height.max())
    lowest = max(float(height.min()), highest - deepest_mm)
    if highest - lowest < _FLAT_MM:
        return np.full((len(x), len(y)), -1.0)
    places = np.stack(np.meshgrid(x, y, [(highest + lowest) / 2], indexing="ij"), -1)
    return -gap(places.reshape(-1, 3)).reshape(len(x), len(y))
