"""A scanned surface as the zero level of a smooth signed distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tactile_fem.errors import PlaceError, TactileError
from tactile_fem.finger.shape import Array
from tactile_fem.runtime.triangles import Triangles
from tactile_fem.stimulus.spline import GridSpline

_STEP_MM = 0.3
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
        cls, surface: Triangles, smooth_mm: float, name: str, least_y: float = -np.inf
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
            The body ends here.

        Raises
        ------
        MeshError
            The surface intersects itself.
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
        shape = (
            np.ceil((np.ptp(surface.points, axis=0) + 2 * _MARGIN_MM) / _STEP_MM).astype(int) + 1
        )
        index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
        points = low + _STEP_MM * index
        winding = igl.fast_winding_number(surface.points, surface.triangles, points)
        squared = igl.point_mesh_squared_distance(points, surface.points, surface.triangles)[0]
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
