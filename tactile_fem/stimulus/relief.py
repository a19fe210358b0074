"""Heights over a plane: levelled, and as a rigid body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from tactile_fem.stimulus.body import EXCESS_MM, Array, Distance
from tactile_fem.stimulus.spline import GridSpline

# Standard deviation of a Gaussian that halves a wave, to its length (ISO 16610-61).
_GAUSSIAN = np.sqrt(np.log(2) / 2) / np.pi


@dataclass(frozen=True)
class Relief:
    """Everything below heights over a plane, ``z = h(x, y)`` in mm; the highest is z = 0."""

    heights: GridSpline

    @classmethod
    def of(
        cls,
        heights: Array,
        spacing: ArrayLike,
        low_pass_mm: float = 0.0,
        beyond: Literal["mirror", "grid-wrap"] = "mirror",
    ) -> Relief:
        """Return the body of heights (nx, ny), filtered by a Gaussian that halves a wavelength.

        Beyond them follows their mirror image, or they themselves again.
        """
        steps = np.asarray(spacing, dtype=float)
        if low_pass_mm:
            heights = ndimage.gaussian_filter(heights, _GAUSSIAN * low_pass_mm / steps, mode=beyond)
        middle = steps * (np.array(heights.shape) - 1) / 2
        top = _highest(GridSpline.through(heights, -middle, steps, beyond), heights)
        return cls(GridSpline.through(heights - top, -middle, steps, beyond))

    def distance(self, points: Array) -> Distance:
        """Return the distance to first order, at `points` (n, 3).

        ``(z - h)/sqrt(1 + |grad h|^2)``: on the surface the value, its gradient and the surface's
        curvature are exact, and the derivatives are exact everywhere. Off a rough surface this is
        far from the true distance. It is therefore kept between lower bounds of that, ``z - h``
        divided by its Lipschitz constant and the height over all heights, and `EXCESS_MM` more.
        """
        h, g, H, T = self.heights.derivatives(points[:, :2], 3)
        v = points[:, 2] - h
        w = 1 / np.sqrt(1 + np.sum(g**2, axis=1))  # cosine of the slope
        a = np.einsum("nij,nj->ni", H, g)  # half the gradient of |grad h|^2
        bend = np.einsum("nik,nkj->nij", H, H) + np.einsum("nijk,nk->nij", T, g)
        w3, w5 = w[:, None, None] ** 3, w[:, None, None] ** 5
        dw = -w3[:, 0] * a
        ddw = 3 * w5 * a[:, :, None] * a[:, None, :] - w3 * bend
        both = g[:, :, None] * dw[:, None, :]
        hessian = np.zeros((len(points), 3, 3))
        hessian[:, :2, :2] = (
            -w[:, None, None] * H - both - both.transpose(0, 2, 1) + v[:, None, None] * ddw
        )
        hessian[:, :2, 2] = hessian[:, 2, :2] = dw
        gap = v * w
        normal = np.column_stack([v[:, None] * dw - w[:, None] * g, w])
        # Where a bound takes the place of the distance, so do its derivatives.
        c = self._least_cosine
        bounds = np.array([c * v, points[:, 2] - EXCESS_MM])
        least = bounds.max(axis=0)
        limited = np.clip(gap, least, least + EXCESS_MM)
        steep, flat = (limited != gap) & (bounds == least)
        normal[steep] = c * np.column_stack([-g, np.ones(len(g))])[steep]
        hessian[steep] = 0.0
        hessian[steep, :2, :2] = -c * H[steep]
        normal[flat], hessian[flat] = [0.0, 0.0, 1.0], 0.0
        return Distance(limited, normal, hessian)

    @cached_property
    def _least_cosine(self) -> float:
        """Cosine of a slope that no point exceeds: slopes are means of the coefficients' steps."""
        spline = self.heights
        ends: Literal["wrap", "reflect"] = "reflect" if spline.beyond == "mirror" else "wrap"
        padded = np.pad(spline.coefficients, 1, mode=ends)
        slopes = [np.abs(np.diff(padded, axis=k)).max() / spline.spacing[k] for k in (0, 1)]
        return float(1 / np.sqrt(1 + np.dot(slopes, slopes)))


def levelled(heights: Array, degree: int) -> Array:
    """Return heights (nx, ny) without the polynomial of this degree that fits them best."""
    # Orthonormal polynomials along each axis; their products are orthonormal over the grid.
    x, y = (
        np.linalg.qr(np.vander(np.linspace(-1, 1, n), degree + 1, increasing=True))[0]
        for n in heights.shape
    )
    shares = x.T @ heights @ y
    i, j = np.indices(shares.shape)
    return heights - x @ np.where(i + j <= degree, shares, 0) @ y.T


def _highest(spline: GridSpline, heights: Array) -> float:
    """Return the largest height of a spline, sought around the highest values."""
    count = min(heights.size, 200)
    top = np.argpartition(heights, heights.size - count, axis=None)[-count:]
    around = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 9)] * 2), -1).reshape(-1, 2)
    index = np.stack(np.unravel_index(top, heights.shape), -1)
    places = spline.origin + spline.spacing * (index[:, None] + around).reshape(-1, 2)
    return float(spline.values(places).max())
