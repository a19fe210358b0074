"""Regions that rings fill and lines cover, by the rules of SVG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Chords of a curve as long as its drawing is large; half as many for a quarter of that.
_CHORDS = 64
# A share of a stroke's width that is as good as nothing.
_TINY = 1e-6


def filled(rings: Sequence[ArrayLike], even_odd: bool = False) -> shapely.Geometry:
    """Return what rings of points (n, 2) fill, each closed from its last point to its first.

    With `even_odd` that is what an odd number of rings goes around, else what they go around more
    often in one direction than in the other (SVG's `nonzero`).
    """
    closed = [
        np.vstack((ring, np.asarray(ring)[:1])) for ring in rings if len(np.asarray(ring)) > 2
    ]
    edges = shapely.union_all([shapely.LineString(ring) for ring in closed])
    (x, y, to_x, to_y) = np.vstack(
        [np.empty((0, 4)), *(np.hstack((ring[:-1], ring[1:])) for ring in closed)]
    ).T
    kept = []
    for face in shapely.get_parts(shapely.polygonize(shapely.get_parts(edges))):
        at = face.representative_point()
        # Edges that cross the ray from the point along X, upwards or downwards.
        k = np.flatnonzero((y > at.y) != (to_y > at.y))
        k = k[x[k] + (at.y - y[k]) * (to_x - x)[k] / (to_y - y)[k] > at.x]
        if k.size % 2 if even_odd else np.sign((to_y - y)[k]).sum():
            kept.append(face)
    return shapely.union_all([shapely.Polygon(), *kept])


def thick(
    points: Array, is_ring: bool, width: float, cap: Any, join: str, limit: float
) -> shapely.Geometry:
    """Return what covers a line of some width."""
    points = points[np.r_[True, np.any(np.diff(points, axis=0), axis=1)]]
    if len(points) == 1:  # caps alone, as if along X
        points, is_ring = points + np.outer([0, _TINY * width], [1, 0]), False
    if is_ring and len(points) < 4:  # there and back: what joins its ends is a cap
        cap, is_ring = "round" if join == "round" else "flat", False
    if not is_ring and len(points) > 2 and (points[0] == points[-1]).all():
        points[-1] += _TINY * (points[-2] - points[-1])  # ends that meet are not joined
    line = shapely.LinearRing(points) if is_ring else shapely.LineString(points)
    rounding = "round" if join == "round" else "bevel"
    parts = [line.buffer(width / 2, quad_segs=64, cap_style=cap, join_style=rounding)]
    corners = np.vstack((points, points[1])) if is_ring else points
    for three in zip(corners, corners[1:], corners[2:], strict=False) if join == "miter" else ():
        into, out = (way / np.linalg.norm(way) for way in np.diff(three, axis=0))
        # SVG limits the length of a miter over the width, 1 / sin(half the angle), or bevels.
        if into @ out < 0.999 and (1 + into @ out) / 2 * limit**2 >= 1:
            corner = shapely.LineString(three)
            parts.append(
                corner.buffer(width / 2, cap_style="flat", join_style="mitre", mitre_limit=limit)
            )
    return shapely.union_all(parts)


def polylines(path: Any, size: float) -> Iterator[tuple[Array, bool]]:
    """Yield the subpaths of a path of some size as points (n, 2), and whether each is closed."""
    points: list[Any] = []
    for segment in path:
        name = type(segment).__name__
        if name == "Move":
            if len(points) > 1:
                yield np.array(points), False
            points = [segment.end]
        elif segment.start is not None and segment.end is not None:
            points = points or [segment.start]
            count = 1
            if name not in ("Line", "Close"):
                count = (
                    int(np.ceil(_CHORDS * np.sqrt(segment.length(error=1e-2) / (size or 1.0)))) + 1
                )
            points += [segment.point(t) for t in np.linspace(0, 1, count + 1)[1:]]
            if name == "Close":
                yield np.array(points), True
                points = []
    if len(points) > 1:
        yield np.array(points), False
