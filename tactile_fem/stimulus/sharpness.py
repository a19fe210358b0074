"""Steep places of heights that are too sharply curved for the skin's facets, and what helps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.relief import Relief

# Where a surface is steeper than this slope, its edges can make the skin's contact change abruptly.
_STEEP = 0.5
# Edges with at least this radius of curvature, and this share of the skin's facets, are harmless,
# and so are walls that rise by less within a window (less by the square of facets below 1 mm).
# Measured as failed steps of scans of a plus, 0.5 mm high if not stated, low_pass_mm 0.05 to 1.
# Facets of 0.25 mm (a section): none at a radius of 0.061 mm, 10 at 0.058 mm. Facets of 1 mm: none
# at 0.12 mm, 4 at 0.085 mm, 6 at 0.017 mm and 0.2 mm high, none at 0.023 mm and 0.1 mm high. Facets
# of 3 mm: none at 0.34 mm, 12 at 0.12 mm.
_LEAST_RADIUS_MM, _RADIUS_PER_FACET = 0.06, 0.1
_LEAST_RISE_MM, _WINDOW_MM = 0.12, 1.0
# Of flat shapes with walls, this share of the points is flatter than this share of the walls.
_FLAT_SHARE, _FLATTER = 0.8, 0.05
_BISECTIONS = 4


@dataclass(frozen=True)
class Edge:
    """The sharpest steep place of a surface.

    Attributes
    ----------
    place_mm
        X and Y in the surface's axes, (2,).
    radius_mm, slope
        Radius of curvature; the largest slope beside it.
    is_flat
        Whether most of the surface is flat, so that it may show flat shapes with walls.
    """

    place_mm: Array
    radius_mm: float
    slope: float
    is_flat: bool

    @property
    def angle_deg(self) -> float:
        """Angle of the wall beside it from the plane."""
        return float(np.degrees(np.arctan(self.slope)))


@dataclass(frozen=True)
class Limits:
    """What skin needs at steep places: a radius of curvature, unless they rise by less."""

    radius_mm: float
    rise_mm: float

    @classmethod
    def of_facets(cls, facet_mm: float) -> Limits:
        """Return the limits of skin with such facets."""
        radius_mm = max(_LEAST_RADIUS_MM, _RADIUS_PER_FACET * facet_mm)
        return cls(radius_mm, _LEAST_RISE_MM * min(facet_mm, 1.0) ** 2)


def sharpest_edge(relief: Relief, limits: Limits) -> Edge | None:
    """Return the sharpest steep place beyond the limits; None without any."""
    heights = relief.heights
    gx, gy = heights.on_grid(1, 0), heights.on_grid(0, 1)
    slope = np.hypot(gx, gy)
    steep = np.nonzero((slope > _STEEP) & (_rise(relief) > limits.rise_mm))
    if not len(steep[0]):
        return None
    curvature = np.zeros_like(slope)
    curvature[steep] = _largest_curvature(
        *(g[steep] for g in (gx, gy)),
        *(heights.on_grid(*orders)[steep] for orders in ((2, 0), (1, 1), (0, 2))),
    )
    at = np.unravel_index(np.argmax(curvature), curvature.shape)
    if curvature[at] * limits.radius_mm <= 1:
        return None
    reach = np.ceil(_WINDOW_MM / 2 / heights.spacing).astype(int)
    beside = tuple(slice(max(k - n, 0), k + n + 1) for k, n in zip(at, reach, strict=True))
    wall = float(slope[beside].max())
    flat = np.quantile(slope, _FLAT_SHARE) < _FLATTER * wall
    place = heights.origin + heights.spacing * np.array(at)
    return Edge(place, float(1 / curvature[at]), wall, bool(flat))


def _rise(relief: Relief) -> Array:
    """Return by how much the heights differ within a window around each point."""
    heights = relief.heights
    values, size = heights.on_grid(0, 0), np.ceil(_WINDOW_MM / heights.spacing).astype(int)
    mode = heights.beyond
    return ndimage.maximum_filter(values, size, mode=mode) - ndimage.minimum_filter(
        values, size, mode=mode
    )


def _largest_curvature(gx: Array, gy: Array, hxx: Array, hxy: Array, hyy: Array) -> Array:
    """Return the larger modulus of the principal curvatures of a graph, 1/mm."""
    squared = 1 + gx**2 + gy**2
    mean = ((1 + gy**2) * hxx - 2 * gx * gy * hxy + (1 + gx**2) * hyy) / (2 * squared**1.5)
    gaussian = (hxx * hyy - hxy**2) / squared**2
    return np.abs(mean) + np.sqrt(np.maximum(mean**2 - gaussian, 0.0))


def low_pass_that_helps(relief: Relief, low_pass_mm: float, limits: Limits) -> float:
    """Return a wavelength, to two digits, of a filter that leaves no place beyond the limits.

    `low_pass_mm` is that of the filter that the surface has been through.
    """

    def is_smooth(wave_mm: float) -> bool:
        further_mm = np.sqrt(wave_mm**2 - low_pass_mm**2)  # Gaussians in turn are one
        return sharpest_edge(relief.smoothed(further_mm), limits) is None

    least = _least(is_smooth, max(low_pass_mm, float(relief.heights.spacing.min())))
    return two_digits(least, math.ceil)


def factor_that_helps(relief: Relief, limits: Limits) -> float:
    """Return the largest factor of heights, below 1, that leaves no place beyond the limits."""
    return 1 / _least(lambda c: sharpest_edge(relief.scaled(1 / c), limits) is None, 1.0)


def two_digits(number: float, rounded: Callable[[float], int] = math.floor) -> float:
    """Return a positive number rounded to two digits, by default down."""
    digit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return digit * rounded(number / digit)


def _least(fits: Callable[[float], bool], above: float) -> float:
    """Return about the least number above one at which a condition that then stays is true."""
    low, high = above, 2 * above
    while not fits(high):
        low, high = high, 2 * high
    for _ in range(_BISECTIONS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if fits(middle) else (middle, high)
    return high
