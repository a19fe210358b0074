"""A measured surface as a rigid body."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy import ndimage

from tactile_fem.runtime.files import cached_by_content
from tactile_fem.stimulus.body import EXCESS_MM, Array, Distance, RigidBody
from tactile_fem.stimulus.spline import GridSpline
from tactile_fem.stimulus.topography import Topography, check_relief, read_topography

if TYPE_CHECKING:
    from tactile_fem.stimulus.surface import Surface

logger = logging.getLogger(__name__)

# Standard deviation of a Gaussian that halves a wave, to its length (ISO 16610-61).
_GAUSSIAN = np.sqrt(np.log(2) / 2) / np.pi
_LEVELS = ["mean", "plane", "quadratic"]
_BEYOND: dict[str, Literal["mirror", "grid-wrap"]] = {"mirrored": "mirror", "periodic": "grid-wrap"}
# Relative error of the distance, this far from the surface, beyond which there is a warning.
_ERROR_AT_MM, _MAX_ERROR = 0.02, 0.1


@dataclass(frozen=True)
class Relief:
    """Everything below heights over a plane, ``z = h(x, y)`` in mm; the highest is z = 0."""

    heights: GridSpline

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


@dataclass(frozen=True)
class Turned:
    """A body turned about Z by `angle` (rad), from X towards Y."""

    body: RigidBody
    angle: float

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        own = self.body.distance(points @ R)
        return Distance(own.gap, own.normal @ R.T, R @ own.hessian @ R.T)


@cached_by_content(maxsize=4)
def make_relief(surface: Surface) -> Relief:
    """Return the body of a measured surface; warn if it is too steep for its distance."""
    relief = relief_of(read_topography(surface), surface)
    error = distance_error(relief, _ERROR_AT_MM)
    if error > _MAX_ERROR:
        logger.warning(
            "stimulus: %g mm from the surface its distance is wrong by up to %.0f %%, because it "
            "is steep and sharply curved: raise stimulus.low_pass_mm (%g)",
            _ERROR_AT_MM,
            100 * error,
            surface.low_pass_mm,
        )
    return relief


def relief_of(topography: Topography, surface: Surface) -> Relief:
    """Return the body of heights that are levelled and filtered as a study states.

    Raises
    ------
    StudyError
        They differ by more than a finger can follow.
    """
    heights = levelled(topography.heights_mm, _LEVELS.index(surface.level))
    check_relief(heights, surface.file)
    beyond = _BEYOND[surface.repeat]
    spacing = np.array(topography.spacing_mm)
    if surface.low_pass_mm:
        sigma = _GAUSSIAN * surface.low_pass_mm / spacing
        heights = ndimage.gaussian_filter(heights, sigma, mode=beyond)
    middle = spacing * (np.array(heights.shape) - 1) / 2
    top = _highest(GridSpline.through(heights, -middle, spacing, beyond), heights)
    return Relief(GridSpline.through(heights - top, -middle, spacing, beyond))


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


def distance_error(relief: Relief, distance_mm: float) -> float:
    """Return the relative error of the distance that 1 in 100 points of the surface exceed."""
    heights = relief.heights
    extent = heights.spacing * np.array(heights.coefficients.shape)
    xy = heights.origin + extent * np.random.default_rng(0).random((10_000, 2))
    # Exactly on the surface as `distance` evaluates it: just below, its gradient is another.
    on = np.column_stack([xy, heights.derivatives(xy, 0)[0]])
    above = on + distance_mm * relief.distance(on).normal
    return float(np.quantile(np.abs(relief.distance(above).gap / distance_mm - 1), 0.99))
