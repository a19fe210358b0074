"""Receptive fields: an afferent with end organs at several points."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from tactile_fem.errors import StudyError


def pool(
    sed_kPa: ArrayLike,
    points_mm: ArrayLike,
    afferents_mm: ArrayLike,
    radius_mm: float,
    rule: Literal["mean", "max"] = "mean",
) -> NDArray[Any]:
    """Return what afferents feel, (t, afferents), of the points within a radius of each.

    Parameters
    ----------
    sed_kPa
        What the points feel, (t, points).
    points_mm, afferents_mm
        Places, (points, d) and (afferents, d).
    radius_mm
        Reach of an afferent's branches.
    rule
        Mean of the points, or the largest value, taken at the samples.

    Raises
    ------
    StudyError
        An afferent has no point within reach, or `sed_kPa` another number of points.
    """
    sed, points = np.asarray(sed_kPa, dtype=float), np.asarray(points_mm, dtype=float)
    if sed.ndim != 2 or sed.shape[1] != len(points):
        raise StudyError(f"sed_kPa has shape {sed.shape}; it needs (t, {len(points)}).")
    fields = cKDTree(points).query_ball_point(np.asarray(afferents_mm, dtype=float), radius_mm)
    for number, near in enumerate(fields):
        if not near:
            raise StudyError(f"No point lies within {radius_mm:g} mm of afferent {number}.")
    combine = np.mean if rule == "mean" else np.max
    return np.column_stack([combine(sed[:, near], axis=1) for near in fields])
