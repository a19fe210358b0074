"""Flat outlines raised from a plate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_fem.stimulus.body import Array, Distance, HalfSpace, norm_of, smooth_minimum
from tactile_fem.stimulus.stimulus import check_limit


class Outline(Protocol):
    """A flat shape that can be raised from a plate.

    A method `gap`, if it has one, returns the signed distance (n,) faster, without derivatives.
    """

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""


@dataclass(frozen=True)
class Embossed:
    """A flat outline raised by `relief` from a plate, its top edge rounded with `fillet`.

    The raised part is a rounded extrusion with its true distance in space; it joins the plate
    by a smooth minimum, twice continuously differentiable, that acts within `blend` mm of the
    foot only.
    """

    outline: Outline
    relief: float
    fillet: float
    blend: float = 0.2

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        whole = HalfSpace(self.relief).distance(points)
        raised, is_top = self._raised(points)
        over_plate = raised - whole.gap
        is_top &= over_plate <= -self.blend
        whole.gap[is_top] = raised[is_top]
        # The outline's derivatives take most of the time; top and plate are flat.
        sides = np.flatnonzero((over_plate < self.blend) & ~is_top)
        plate = Distance(whole.gap[sides], whole.normal[sides], whole.hessian[sides])
        united = smooth_minimum(self._extrusion(points[sides]), plate, self.blend)
        whole.gap[sides], whole.normal[sides] = united.gap, united.normal
        whole.hessian[sides] = united.hessian
        return whole

    def _raised(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the distance from the extrusion, and where it is that from its flat top."""
        xy, gap_alone = points[:, :2], getattr(self.outline, "gap", None)
        gap = gap_alone(xy) if gap_alone else self.outline.distance(xy).gap
        a, b = gap + self.fillet, points[:, 2] + self.fillet
        corner = (a > 0) & (b > 0)
        raised = np.where(corner, np.hypot(a, b), np.maximum(a, b)) - self.fillet
        return raised, ~corner & (a <= b)

    def _extrusion(self, points: Array) -> Distance:
        """Return the distance of ``{d <= 0, z <= 0}`` shrunk and swollen by the fillet radius."""
        planar = self.outline.distance(points[:, :2])
        a, b = planar.gap + self.fillet, points[:, 2] + self.fillet
        r, n, H = norm_of(np.column_stack([a, b]))
        corner = (a > 0) & (b > 0)
        wall = (a > b) & ~corner
        da = np.where(corner, n[:, 0], np.where(wall, 1.0, 0.0))
        db = np.where(corner, n[:, 1], np.where(wall, 0.0, 1.0))
        gap = np.where(corner, r, np.maximum(a, b)) - self.fillet
        normal = np.column_stack([da[:, None] * planar.normal, db])
        hessian = np.zeros((len(points), 3, 3))
        g = planar.normal
        bend = np.where(corner[:, None, None], H, 0.0)
        hessian[:, :2, :2] = (
            bend[:, 0, 0, None, None] * g[:, :, None] * g[:, None, :]
            + da[:, None, None] * planar.hessian
        )
        hessian[:, :2, 2] = hessian[:, 2, :2] = bend[:, 0, 1, None] * g
        hessian[:, 2, 2] = bend[:, 1, 1]
        return Distance(gap, normal, hessian)


def embossed(
    outline: Outline, relief_mm: float, fillet_mm: float, limits: Mapping[str, float]
) -> Embossed:
    """Return a raised outline; raise StudyError if the fillet exceeds the relief or a limit."""
    check_limit("fillet_radius_mm", fillet_mm, {"relief_mm": relief_mm, **limits})
    return Embossed(outline, relief_mm, fillet_mm)
