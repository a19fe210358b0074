"""A scanned surface as the zero level of a smooth signed distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tactile_fem.errors import MeshError, PlaceError, TactileError
from tactile_fem.finger.shape import Array
from tactile_fem.runtime.triangles import Triangles, in_chunks
from tactile_fem.stimulus.spline import GridSpline

_STEP_MM = 0.3
_MOST_POINTS = 6_000_000  # some 200 bytes each while they are sampled
_MARGIN_MM = 3.0
# Winding numbers of points that lie in two solids, or in one that is inside out.
_DOUBLE, _INVERTED = 1.5, -0.5
# Along a line to the surface: steps, and how near they have to come.
_STEPS, _CLOSE_MM = 30, 1e-4


@dataclass(frozen=True)
class SmoothSurface:
    """The smoothed signed distance of a closed or nearly closed surface, negative inside.

    Attributes
    ----------
    spline
        Of the distance, mm.
    """

    spline: GridSpline

    @classmethod
    def of(
        cls, surface: Triangles, smooth_mm: float, name: str, least_y: float, closed: bool
    ) -> SmoothSurface:
        """Sample the distance on a grid and smooth it by a Gaussian.

        Parameters
        ----------
        surface
            In the finger's axes.
        smooth_mm
            Standard deviation. A surface of radius R moves by ``smooth_mm^2/R`` towards its centre.
        name
            The key of the surface's file, for messages.
        least_y
            The body ends here, or is of no interest beyond; it is sampled to 3 mm beyond.
        closed
            Whether it ends there in a plane.

        Raises
        ------
        MeshError
            The surface intersects itself, or is too large.
        TactileError
            libigl is missing.
        """
        try:
            import igl
        except ModuleNotFoundError:
            raise TactileError(
                'Fingers from scanned surfaces need libigl: pip install "tactile-fem[cad]".'
            ) from None
        low = surface.points.min(axis=0) - _MARGIN_MM
        high = surface.points.max(axis=0) + _MARGIN_MM
        # Whole steps, so that the grid does not depend on how far the scan goes on.
        low[1] += _STEP_MM * max((least_y - _MARGIN_MM - low[1]) // _STEP_MM, 0)
        shape = np.ceil((high - low) / _STEP_MM).astype(int) + 1
        if math.prod(shape.tolist()) > _MOST_POINTS:
            raise MeshError(
                f"{name}: what lies in the finger's length is "
                f"{' x '.join(f'{x:.0f}' for x in high - low - 2 * _MARGIN_MM)} mm large, more "
                "than a finger: leave out the rest, or check tip_direction and nail_direction"
            )
        index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
        points = low + _STEP_MM * index

        def signed(some: Array) -> tuple[Array, Array]:
            found = igl.point_mesh_squared_distance(some, surface.points, surface.triangles)[0]
            return igl.fast_winding_number(surface.points, surface.triangles, some), found

        winding, squared = in_chunks(signed, points)
        distance = np.sqrt(squared)
        clear = distance > _STEP_MM
        for wrong, what in (
            (clear & (winding > _DOUBLE), "overlaps itself"),
            (clear & (winding < _INVERTED), "is inside out"),
        ):
            if wrong.any():
                worst = np.argmax(np.where(wrong, distance, 0.0))
                raise PlaceError(f"{name}: the surface {what} {{place}}; repair it", points[worst])
        distance[winding > 0.5] *= -1
        if closed:
            distance = np.maximum(distance, least_y - points[:, 1])
        smoothed = ndimage.gaussian_filter(
            distance.reshape(shape), smooth_mm / _STEP_MM, mode="nearest"
        )
        return cls(GridSpline.through(smoothed, low, (_STEP_MM,) * 3))

    def moved(self, by: Array) -> SmoothSurface:
        """Return the surface moved by (3,) mm."""
        spline = self.spline
        return SmoothSurface(
            GridSpline(spline.coefficients, spline.origin + by, spline.spacing, spline.beyond)
        )

    def level(self, points: Array) -> Array:
        """Return the distance (n,) at points (n, 3), mm; beyond the grid that of its rim."""
        return self.spline.derivatives(self._within(points), 0)[0]

    def normals(self, points: Array) -> Array:
        """Return outward unit normals (n, 3) of the level at points (n, 3)."""
        gradient = self.spline.derivatives(self._within(points), 1)[1]
        return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)

    def along(self, points: Array, directions: Array, reach_mm: float) -> Array:
        """Return the distances (n,) from points to the surface along lines; NaN if too far.

        The lines lead outwards, about along the normals, where the level is the way to go.
        """
        t = np.zeros(len(points))
        for _ in range(_STEPS):
            t = np.clip(t - self.level(points + t[:, None] * directions), -reach_mm, reach_mm)
        left = np.abs(self.level(points + t[:, None] * directions))
        return np.where(left < _CLOSE_MM, t, np.nan)

    def project(self, points: Array) -> Array:
        """Return the surface's points next to points (n, 3) near it."""
        for _ in range(10):
            value, gradient = self.spline.derivatives(self._within(points), 1)
            step = value / np.maximum(np.einsum("ni,ni->n", gradient, gradient), 0.1)
            points = points - step[:, None] * gradient
        return points

    def _within(self, points: Array) -> Array:
        first = self.spline.origin
        last = first + self.spline.spacing * (np.array(self.spline.coefficients.shape) - 1)
        return np.clip(points, first, last)
