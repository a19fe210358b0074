"""Flat shapes with rounded corners and their signed distance as a spline: letters and drawings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array, Distance
from tactile_fem.stimulus.spline import GridSpline

# Corners of a smaller radius are not resolved.
_LEAST_RADIUS_MM = 0.05
# Radii of the outline's corners and of the top edge, unless others are given or shapes too thin.
USUAL_RADIUS_MM = 0.3
_GRID_MM = 0.05
# Farther from an outline than its relief and this, the distance is constant: the plate is nearer.
_BEYOND_RELIEF_MM = 0.6
# How much farther the grid of a shape's distance reaches.
_MARGIN_MM = 0.4
# A corner turns by less, and in rounding loses less than so many radii.
_CORNER_TURN, _LONGEST_CORNER = 0.95 * math.pi, 4.0
# Outlines closer than this many radii are the same: chords of the rounded one are off by less.
_SAME_RADII = 2e-3
# In the search for the largest radius that fits.
_BISECTIONS = 10


@dataclass(frozen=True)
class Rounded:
    """A shape: its signed distance as a spline on a grid around it; `polygon` in mm."""

    polygon: shapely.Geometry
    spline: GridSpline
    bounds: tuple[float, float, float, float]


class Outlines:
    """Shapes in their places.

    Parameters
    ----------
    placed
        Shapes in mm, and how far each is shifted (X, Y). Equal shapes are rounded once.
    corner_radius_mm
        Radius of corners, which each shape must allow; see `radii_that_fit`.
    relief_mm
        How high they will be raised.
    """

    def __init__(
        self,
        placed: Sequence[tuple[shapely.Geometry, tuple[float, float]]],
        corner_radius_mm: float,
        relief_mm: float,
    ) -> None:
        self._far_mm = relief_mm + _BEYOND_RELIEF_MM
        reach = self._far_mm + _MARGIN_MM
        self._placed = [
            (np.array(shift), _splined(shape, corner_radius_mm, reach)) for shape, shift in placed
        ]

    def polygons(self) -> list[shapely.Geometry]:
        """Return the outlines in the body's frame."""
        return [affinity.translate(shape.polygon, *shift) for shift, shape in self._placed]

    def gap(self, xy: Array) -> Array:
        """Return the signed distance (n,) at `xy` (n, 2); constant far from all shapes."""
        return self._nearest(xy)[0]

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance at `xy` (n, 2); constant far from all shapes."""
        gap, nearest = self._nearest(xy)
        result = Distance(gap, np.zeros((len(xy), 2)), np.zeros((len(xy), 2, 2)))
        for k, (shift, shape) in enumerate(self._placed):
            here = np.flatnonzero(nearest == k)
            _, slope, bend = shape.spline.derivatives(xy[here] - shift, 2)
            result.normal[here], result.hessian[here] = slope, bend
        return result

    def _nearest(self, xy: Array) -> tuple[Array, NDArray[np.intp]]:
        """Return the signed distance (n,) and the index of the nearest shape, -1 far from all."""
        gap, nearest = np.full(len(xy), self._far_mm), np.full(len(xy), -1)
        for k, (shift, shape) in enumerate(self._placed):
            here, low, high = xy - shift, shape.bounds[:2], shape.bounds[2:]
            near = np.flatnonzero(np.all((here > low) & (here < high), axis=1))
            d = shape.spline.values(here[near])
            nearer = d < gap[near]
            gap[near[nearer]], nearest[near[nearer]] = d[nearer], k
        return gap, nearest


def radii_that_fit(
    shapes: Mapping[str, shapely.Geometry],
    corner_mm: float | None,
    fillet_mm: float | None,
    relief_mm: float,
    where: str = "",
) -> tuple[float, float]:
    """Return the radii of corners and of the top edge in mm, the usual ones where None is given.

    Parameters
    ----------
    shapes
        Shapes by what a message calls them.
    corner_mm, fillet_mm
        Given ones, or None: 0.3 mm, or the largest that fits if this is less.
    relief_mm
        Height of the shapes; least height if they differ.
    where
        What follows their names in a message.

    Raises
    ------
    StudyError
        Strokes or gaps are too thin for a given radius, or the relief too low; with what fits.
    """
    wanted = USUAL_RADIUS_MM if corner_mm is None else corner_mm
    thin = [name for name, shape in shapes.items() if _rounded(shape, wanted) is None]
    fits = min((_largest_radius(shapes[name], wanted) for name in thin), default=wanted)
    strokes = f"strokes or gaps of {', '.join(thin)}{where} are too thin"
    limit, limit_name = (fits, "corner_radius_mm") if fits < relief_mm else (relief_mm, "relief_mm")
    problems = []
    if thin and fits < _LEAST_RADIUS_MM:
        problems.append(
            f"stimulus: {strokes}: rounded by {_LEAST_RADIUS_MM:g} mm, the least radius that is "
            "resolved, something would vanish; make the stimulus larger or simpler"
        )
    elif thin and corner_mm is not None:
        problems.append(
            f"stimulus.corner_radius_mm = {corner_mm:g}: {strokes}, which must be less than half "
            f"of each; it must not exceed {fits:g}"
        )
    # A shape that the wanted radius fits need not allow the smaller one that others need.
    elif odd := [name for name, shape in shapes.items() if _rounded(shape, fits) is None]:
        problems.append(
            f"stimulus: {', '.join(odd)} cannot be rounded by {fits:g} mm, which others need; set "
            "another corner_radius_mm"
        )
    if fillet_mm is not None and fillet_mm > limit + 1e-12:
        problems.append(
            f"stimulus.fillet_radius_mm = {fillet_mm:g} must not exceed {limit_name} ({limit:g})"
        )
    if problems:
        raise StudyError("; ".join(problems))
    return fits, min(USUAL_RADIUS_MM, limit) if fillet_mm is None else fillet_mm


def _largest_radius(shape: shapely.Geometry, above: float) -> float:
    """Return the largest radius below `above` mm that fits a shape, by bisection, rounded down."""
    fits = 0.0
    for _ in range(_BISECTIONS):
        middle = (fits + above) / 2
        fits, above = (fits, middle) if _rounded(shape, middle) is None else (middle, above)
    digit = 10.0 ** (math.floor(math.log10(fits)) - 1) if fits else 1.0
    return digit * math.floor(fits / digit)


def _topology(shape: shapely.Geometry) -> tuple[int, int]:
    """Return the number of parts and of holes."""
    parts = shapely.get_parts(shape)
    return len(parts), int(shapely.get_num_interior_rings(parts).sum())


@lru_cache(maxsize=64)
def _rounded(shape: shapely.Geometry, radius: float) -> shapely.Geometry | None:
    """Return a shape with rounded corners, None if the radius takes away more than corners."""
    # Morphological opening rounds convex corners, closing rounds concave ones.
    opened = shape.buffer(-radius, quad_segs=32).buffer(radius, quad_segs=32)
    rounded = opened.buffer(radius, quad_segs=32).buffer(-radius, quad_segs=32)
    # Parts that touch in a point, as pixels over a corner do, may become one or two.
    joined = shape.buffer(_SAME_RADII * radius)
    if rounded.is_empty or _topology(rounded) not in (_topology(shape), _topology(joined)):
        return None  # a part or a hole has vanished
    lost = shapely.distance(rounded, shapely.points(shapely.get_coordinates(shape))).max()
    if lost > _LONGEST_CORNER * radius or _largest_turn(shape, rounded, radius) > _CORNER_TURN:
        return None
    return rounded


def _largest_turn(shape: shapely.Geometry, rounded: shapely.Geometry, radius: float) -> float:
    """Return by how much the outline turns where it was changed, at most; rad.

    At the end of a stroke or of a gap it turns by half a circle, at a corner by less.
    """
    kept = rounded.boundary.buffer(_SAME_RADII * radius)
    changed = shapely.line_merge(shape.boundary.difference(kept))
    turns = [0.0]
    for piece in shapely.get_parts(changed):
        way = np.diff(shapely.get_coordinates(piece), axis=0)
        angle = np.diff(np.arctan2(way[:, 1], way[:, 0]))
        turns.append(abs(float(((angle + np.pi) % (2 * np.pi) - np.pi).sum())))
    return max(turns)


@lru_cache(maxsize=64)
def _splined(shape: shapely.Geometry, radius: float, reach: float) -> Rounded:
    """Round a shape's corners and spline its signed distance on a grid that goes on by `reach`."""
    rounded = _rounded(shape, radius)
    assert rounded is not None, "_rounded has been tried with this radius"
    low = np.array(rounded.bounds[:2]) - reach
    high = np.array(rounded.bounds[2:]) + reach
    x, y = (np.arange(a, b + _GRID_MM, _GRID_MM) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    points = shapely.points(grid)
    shapely.prepare(rounded)
    edges = shapely.STRtree(_edges(rounded))  # three times as fast as `shapely.distance`
    _, distance = edges.query_nearest(points, all_matches=False, return_distance=True)
    distance[shapely.contains(rounded, points)] *= -1
    spline = GridSpline.through(distance.reshape(len(x), len(y)), low, (_GRID_MM, _GRID_MM))
    return Rounded(rounded, spline, (*low, *high))


def _edges(shape: shapely.Geometry) -> NDArray[np.object_]:
    """Return the straight parts of a shape's boundary."""
    rings = shapely.get_rings(shapely.get_parts(shape))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    return shapely.linestrings(np.stack([corners[:-1][same], corners[1:][same]], axis=1))
