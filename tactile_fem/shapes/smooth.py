"""A scanned surface as the zero level of a smooth signed distance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tactile_fem.errors import MeshError, PlaceError, TactileError
from tactile_fem.shapes.surface_files import Array, Triangles, in_chunks
from tactile_fem.stimulus import GridSpline

_STEP_MM, _MARGIN_MM = 0.3, 3.0
_MOST_POINTS = 6_000_000  # some 200 bytes each while they are sampled
# Winding numbers of points that lie in two solids, or in one that is inside out.
_DOUBLE_WINDING, _INVERTED_WINDING = 1.5, -0.5
# Iterations along a line to the surface, and the distance of a point that has reached it; Newton's
# iterations to the nearest point of the surface.
_LINE_ITERATIONS, _LINE_TOLERANCE_MM, _PROJECTION_ITERATIONS = 30, 1e-4, 10


@dataclass(frozen=True)
class SmoothSurface:
    """The smoothed signed distance of a closed or nearly closed surface in mm, negative inside.

    It is a cubic spline of X, Y, Z; beyond its grid the distance is that of the rim of the grid.
    """

    spline: GridSpline

    @classmethod
    def of(
        cls, surface: Triangles, smooth_mm: float, name: str, least_y: float, closed: bool
    ) -> SmoothSurface:
        """Sample the distance on a grid and smooth it by a Gaussian.

        A surface of radius R moves by ``smooth_mm^2/R`` towards its centre. `name` is the key of
        its file, for messages. At `least_y` the body ends in a plane, if it is `closed`, or is of
        no interest beyond; it is sampled to 3 mm beyond. Raises MeshError if the surface intersects
        itself or is too large, TactileError if libigl is missing.
        """
        from scipy import ndimage  # takes a while

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
        shape = (np.ceil((high - low) / _STEP_MM).astype(int) + 1).tolist()
        if math.prod(shape) > _MOST_POINTS:
            raise MeshError(
                f"{name}: what lies in the finger's length is "
                f"{' x '.join(f'{x:.0f}' for x in high - low - 2 * _MARGIN_MM)} mm large, more "
                "than a finger: leave out the rest, or check tip_direction and nail_direction"
            )
        points = low + _STEP_MM * np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3)

        def signed(some: Array) -> tuple[Array, Array]:
            found = igl.point_mesh_squared_distance(some, surface.points, surface.triangles)[0]
            return igl.fast_winding_number(surface.points, surface.triangles, some), found

        winding, squared = in_chunks(signed, points)
        distance = np.sqrt(squared)
        clear = distance > _STEP_MM
        for wrong, what in (
            (clear & (winding > _DOUBLE_WINDING), "overlaps itself"),
            (clear & (winding < _INVERTED_WINDING), "is inside out"),
        ):
            if wrong.any():
                worst = np.argmax(np.where(wrong, distance, 0.0))
                raise PlaceError(f"{name}: the surface {what} {{place}}; repair it", points[worst])
        distance[winding > 0.5] *= -1
        if closed:
            distance = np.maximum(distance, least_y - points[:, 1])
        distance = distance.reshape(shape)
        smooth = ndimage.gaussian_filter(distance, smooth_mm / _STEP_MM, mode="nearest")
        return cls(GridSpline.through(smooth, low, [_STEP_MM] * 3))

    def moved(self, by: Array) -> SmoothSurface:
        """Return the surface moved by (3,) mm."""
        return SmoothSurface(replace(self.spline, origin=self.spline.origin + by))

    def level(self, points: Array) -> Array:
        """Return the distance (n,) at points (n, 3), mm."""
        return self.spline.values(self._within(points))

    def normals(self, points: Array) -> Array:
        """Return outward unit normals (n, 3) of the level at points (n, 3)."""
        gradient = self.spline.derivatives(self._within(points), 1)[1]
        return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)

    def along(self, points: Array, directions: Array, reach_mm: float) -> Array:
        """Return the distances (n,) from points to the surface along outward lines, or NaN."""
        # The lines are about the normals, so that the distance is about the step.
        t = np.zeros(len(points))
        for _ in range(_LINE_ITERATIONS):
            t = np.clip(t - self.level(points + t[:, None] * directions), -reach_mm, reach_mm)
        error = np.abs(self.level(points + t[:, None] * directions))
        return np.where(error < _LINE_TOLERANCE_MM, t, np.nan)

    def project(self, points: Array) -> Array:
        """Return the points of the surface next to points (n, 3) near it."""
        for _ in range(_PROJECTION_ITERATIONS):
            level, gradient = self.spline.derivatives(self._within(points), 1)
            step = level / np.maximum(np.sum(gradient**2, axis=1), 0.1)
            points = points - step[:, None] * gradient
        return points

    def _within(self, points: Array) -> Array:
        first, count = self.spline.origin, np.array(self.spline.coefficients.shape)
        return np.clip(points, first, first + _STEP_MM * (count - 1))
