"""Receptive fields: an afferent with end organs at several points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from tactile_fem.errors import StudyError

Array = NDArray[Any]


@dataclass(frozen=True)
class ReceptiveField:
    """Which points each afferent feels and how it puts them together.

    Attributes
    ----------
    weights
        (afferents, points), every afferent with at least one point.
    rule
        "sum" is the weighted sum; "max" the largest weighted value, taken at the samples.
    """

    weights: csr_array
    rule: Literal["sum", "max"] = "sum"

    def __post_init__(self) -> None:
        if (np.diff(self.weights.indptr) == 0).any() or self.weights.nnz == 0:
            raise StudyError("Every afferent needs a point in its receptive field.")

    @classmethod
    def around(
        cls,
        afferents_mm: ArrayLike,
        points_mm: ArrayLike,
        radius_mm: float,
        rule: Literal["sum", "max"] = "sum",
    ) -> ReceptiveField:
        """Return fields of all points within a radius: their mean, or the largest.

        Parameters
        ----------
        afferents_mm, points_mm
            Places, (afferents, d) and (points, d).
        radius_mm
            Reach of an afferent's branches.

        Raises
        ------
        StudyError
            An afferent has no point within reach.
        """
        places = np.asarray(afferents_mm, dtype=float)
        found = cKDTree(np.asarray(points_mm, dtype=float)).query_ball_point(places, radius_mm)
        counts = np.array([len(points) for points in found], dtype=np.int64)
        if (counts == 0).any():
            raise StudyError(
                f"No point lies within {radius_mm:g} mm of afferent {np.argmin(counts)}."
            )
        row, column = np.repeat(np.arange(len(counts)), counts), np.concatenate(found)
        weight = np.ones(len(row)) if rule == "max" else 1 / counts[row]
        shape = len(places), len(np.asarray(points_mm))
        return cls(csr_array((weight, (row, column.astype(np.int64))), shape=shape), rule)

    def combine(self, sed_kPa: ArrayLike) -> Array:
        """Return what the afferents feel, (t, afferents), of what the points do, (t, points)."""
        sed, weights = np.asarray(sed_kPa, dtype=float), self.weights
        if sed.ndim != 2 or sed.shape[1] != weights.shape[1]:
            raise StudyError(f"sed_kPa has shape {sed.shape}; it needs (t, {weights.shape[1]}).")
        if self.rule == "sum":
            return (weights @ sed.T).T
        felt = sed[:, weights.indices] * weights.data
        return np.maximum.reduceat(felt, weights.indptr[:-1], axis=1)
