"""What closed lines fill: fonts and SVG count how often they go around a place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

Rule = Literal["nonzero", "evenodd"]


def filled(rings: Sequence[ArrayLike], rule: Rule) -> shapely.Geometry:
    """Return the region that rings of points (n, 2), closed or not, fill together.

    Parameters
    ----------
    rings
        They may cross themselves and each other.
    rule
        "nonzero": they go around a place more often in one sense than in the other. "evenodd": they
        go around it an odd number of times.
    """
    points = [np.asarray(ring, dtype=float) for ring in rings]
    closed = [np.concatenate([ring, ring[:1]]) for ring in points if len(ring) > 2]
    lines = shapely.union_all([shapely.LineString(ring) for ring in closed])
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    if not len(faces):
        return shapely.Polygon()
    places = shapely.get_coordinates(shapely.point_on_surface(faces))
    turns = sum(_winding_numbers(places, ring) for ring in closed)
    return shapely.union_all(faces[turns != 0 if rule == "nonzero" else turns % 2 == 1])


def _winding_numbers(places: NDArray[Any], ring: NDArray[Any]) -> NDArray[np.int64]:
    """Return how often a ring goes around places (n, 2), counterclockwise, by crossings of a ray.

    See Hormann and Agathos (2001, DOI 10.1016/S0925-7721(01)00012-8).
    """
    (x, y), (ahead_x, ahead_y) = ring[:-1].T, np.diff(ring, axis=0).T
    px, py = places[:, 0, None], places[:, 1, None]
    left = ahead_x * (py - y) - ahead_y * (px - x)
    is_above, ends_above = y > py, y + ahead_y > py
    upwards = ~is_above & ends_above & (left > 0)
    downwards = is_above & ~ends_above & (left < 0)
    counted: NDArray[np.int64] = upwards.sum(axis=1) - downwards.sum(axis=1)
    return counted
