"""Values on a regular grid between its points: linear, or cubic splines with all derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement, permutations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from tactile_fem.stimulus.body import Array

# Powers of a coordinate within its interval (rows) in the four B-splines that act there (columns).
_PIECES = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6


def linear_between(
    values: NDArray[np.floating],
    origin: ArrayLike,
    spacing: ArrayLike,
    points: Array,
    beyond: float | None = None,
) -> Array:
    """Return values (n,) at points (n, d) of a grid of d axes; beyond it a value, or the nearest.

    The grid begins at `origin` (d,) and has the `spacing` (d,) or one for all axes.
    """
    place = ((points - np.asarray(origin)) / spacing).T
    mode, value = ("nearest", 0.0) if beyond is None else ("constant", beyond)
    return ndimage.map_coordinates(values, place, np.float64, order=1, mode=mode, cval=value)


@dataclass(frozen=True)
class GridSpline:
    """An interpolating cubic spline, twice continuously differentiable, in any dimension d.

    `coefficients` are those of the B-splines at the grid's points, along d axes; `origin` (d,) is
    its first point and `spacing` (d,) the distance between points. Beyond the grid its mirror image
    in the last points follows, or the grid again ("grid-wrap": one spacing after the last point).
    """

    coefficients: Array
    origin: Array
    spacing: Array
    beyond: Literal["mirror", "grid-wrap"] = "mirror"

    @classmethod
    def through(
        cls,
        values: Array,
        origin: ArrayLike,
        spacing: ArrayLike,
        beyond: Literal["mirror", "grid-wrap"] = "mirror",
    ) -> GridSpline:
        """Return the spline through values on a grid."""
        coefficients = ndimage.spline_filter(values, order=3, mode=beyond)
        return cls(coefficients, np.asarray(origin, float), np.asarray(spacing, float), beyond)

    def values(self, points: Array) -> Array:
        """Return the values (n,) at points (n, d), faster than with derivatives."""
        place = (points - self.origin) / self.spacing
        return ndimage.map_coordinates(
            self.coefficients, place.T, order=3, mode=self.beyond, prefilter=False
        )

    def derivatives(self, points: Array, highest: int) -> list[Array]:
        """Return value (n,), gradient (n, d), Hessian (n, d, d) ... up to the order `highest` <= 3.

        The points are (n, d). (`NdBSpline` takes twice as long, as it shares no work between them.)
        """
        d = self.coefficients.ndim
        place = (points - self.origin) / self.spacing
        interval = np.floor(place).astype(np.int64)
        weights = [
            [_weights(place[:, axis] - interval[:, axis], order) for order in range(highest + 1)]
            for axis in range(d)
        ]
        support = self._support(interval)
        found = []
        for order in range(highest + 1):
            tensor = np.empty((len(points),) + (d,) * order)
            for axes in combinations_with_replacement(range(d), order):
                value = support
                for axis in reversed(range(d)):
                    value = np.einsum("n...k,nk->n...", value, weights[axis][axes.count(axis)])
                value = value / np.prod(self.spacing[list(axes)])
                for same in set(permutations(axes)):
                    np.moveaxis(tensor, 0, -1)[same] = value
            found.append(tensor)
        return found

    def _support(self, interval: NDArray[np.int64]) -> Array:
        """Return the coefficients of the B-splines that act in each interval, (n, 4, ...)."""
        index = []
        for axis, count in enumerate(self.coefficients.shape):
            k = interval[:, axis, None] + np.arange(-1, 3)
            if self.beyond == "mirror":
                k = np.mod(k, 2 * (count - 1))
                k = np.minimum(k, 2 * (count - 1) - k)
            else:
                k = np.mod(k, count)
            shape = [len(k)] + [1] * self.coefficients.ndim
            shape[1 + axis] = 4
            index.append(k.reshape(shape))
        return self.coefficients[tuple(index)]


def _weights(t: Array, order: int) -> Array:
    """Return the derivative of the four B-splines at places t (n,) in their interval, (n, 4)."""
    powers = np.arange(4)
    falling = np.array([np.prod(np.arange(p, p - order, -1)) for p in powers])
    return (falling * t[:, None] ** np.maximum(powers - order, 0)) @ _PIECES
