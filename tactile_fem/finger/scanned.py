"""A scanned skin: a capsule that is moved along its normals onto the smoothed scan.

So it is triangulated as the analytic finger is, with triangles of the wanted size, whatever those
of the file are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.finger.frame import Frame
from tactile_fem.finger.plane import Array
from tactile_fem.finger.scans import beyond, connected
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import ARC_END, Capsule
from tactile_fem.finger.simplex import lowest_height
from tactile_fem.finger.smooth import SmoothSurface
from tactile_fem.runtime.triangles import Triangles

_BEYOND_CUT_MM = 1.0  # length of the scan beyond the cut, where it may be open
_REACH_MM = 3.0  # by which the capsule is moved at most
_CONTACT_FROM_CUT_MM, _CONTACT_FROM_TIP_MM = 3.0, 1.0
_LARGEST_WIDTH_MM, _EDGE_MM = 45.0, 3.0  # edges from which the width is measured
_FIT_STEP_MM, _LOWEST_STEP_MM = 1.5, 0.25  # between samples, to fit and to find the lowest point


@dataclass(frozen=True)
class ScannedSkin:
    """A capsule that is moved along its normals onto a smoothed scan."""

    capsule: Capsule
    surface: SmoothSurface

    @classmethod
    def of(cls, skin: Triangles, finger: Finger, frame: Frame) -> ScannedSkin:
        """Fit the capsule to a scan.

        Raises
        ------
        MeshError
            The scan is too short, has a hole, intersects itself, or is no finger.
        """
        length = finger.tip_length_mm + finger.straight_length_mm
        whole, skin = skin, beyond(skin, -length - _BEYOND_CUT_MM - _REACH_MM)
        if skin is not whole:  # fingers of one hand are apart here
            skin = connected(skin, np.zeros(3))
        tip = float(skin.points[:, 1].max())
        cut = tip - length
        _check_contact(skin, finger, frame, (cut, tip))
        _check_length(skin, cut)
        skin = beyond(skin, cut - _BEYOND_CUT_MM - _REACH_MM)
        _check_holes(skin, cut)
        guess = _guess(skin, finger, tip, cut)
        surface = SmoothSurface.of(
            skin, finger.smooth_mm, "finger.skin_file", cut - _BEYOND_CUT_MM, closed=False
        )
        return cls(_fitted(guess, surface), surface)

    def place(self, reference: Array) -> tuple[Array, Array]:
        """Move points of the reference capsule onto the scan; see `Capsule.place`.

        Raises
        ------
        MeshError
            The scan is too far from the capsule.
        """
        points, directions = self.capsule.place(reference)
        in_cut = points[:, 1] < self.capsule.cut_y + 1e-9  # remains in the plane
        directions[in_cut, 1] = 0.0
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        t = self.surface.along(points, directions, _REACH_MM)
        if np.isnan(t).any():
            raise PlaceError(
                f"finger.skin_file: the skin is more than {_REACH_MM:g} mm from the shape of a "
                "finger {place}: check tip_direction, nail_direction and contact_mm",
                points[np.argmax(np.isnan(t))],
            )
        points = points + t[:, None] * directions
        return points, self.surface.normals(points)

    def level(self, points: Array) -> Array:
        """Return a function of points (n, 3) that is negative inside and zero on the skin."""
        return self.surface.level(points)

    def sample(self, step_mm: float) -> tuple[Array, Array]:
        """Return points about `step_mm` apart and their normals."""
        return self.place(self.capsule.reference(step_mm))

    def on_the_plane(self) -> tuple[ScannedSkin, Array]:
        """Return the skin with its lowest point at z = 0, and by how much it moved, (3,)."""
        points, _ = self.sample(_LOWEST_STEP_MM)
        by = np.array([0.0, 0.0, -points[:, 2].min()])
        capsule = replace(self.capsule, axis_z=self.capsule.axis_z + by[2])
        return ScannedSkin(capsule, self.surface.moved(by)), by


def _check_length(skin: Triangles, cut: float) -> None:
    first = float(skin.points[:, 1].min())
    if first > cut - _BEYOND_CUT_MM:
        last = float(skin.points[:, 1].max())
        raise MeshError(
            f"finger.skin_file is {last - first:.1f} mm long, but tip_length_mm and "
            f"straight_length_mm ask for {last - cut:.1f} mm and {_BEYOND_CUT_MM:g} mm more: "
            "shorten straight_length_mm, or correct tip_direction"
        )


def _check_holes(skin: Triangles, cut: float) -> None:
    pairs, count = np.unique(np.sort(skin.edges(), axis=1), axis=0, return_counts=True)
    middle = skin.points[pairs[count == 1]].mean(axis=1)
    inside = middle[middle[:, 1] > cut - _BEYOND_CUT_MM]
    if len(inside):
        raise PlaceError(
            "finger.skin_file has a hole {place}: close it (only its proximal end may be open)",
            inside[0],
        )


def _check_contact(
    skin: Triangles, finger: Finger, frame: Frame, ends: tuple[float, float]
) -> None:
    """Raise PlaceError if the origin is no point of a pad between the cut and the tip."""
    import trimesh  # takes 0.15 s

    (cut, tip), place = ends, np.zeros(3)
    x, y, z = frame.origin
    if finger.contact_mm is not None:
        contact = f"finger.contact_mm = {[round(float(c), 3) for c in frame.origin]}"
        remedy = "correct it, tip_direction or nail_direction"
    else:
        contact = f"the contact point (contact_from_tip_mm = {finger.contact_from_tip_mm:g})"
        if finger.nail_direction is not None:
            contact = "the lowest point of finger.skin_file along nail_direction"
        contact += f", at {x:.1f}, {y:.1f}, {z:.1f} mm in the file,"
        remedy = "give contact_mm, a point of the pad, or correct tip_direction or nail_direction"
    least, most = _CONTACT_FROM_TIP_MM, tip - cut - _CONTACT_FROM_CUT_MM
    if not least <= tip <= most:
        raise PlaceError(
            f"{contact} lies {tip:.1f} mm behind the tip, but it must lie {least:g} to {most:g} mm "
            "behind it, as the finger is cut at tip_length_mm + straight_length_mm = "
            f"{tip - cut:g} mm: {remedy}",
            place,
        )
    nearest = trimesh.triangles.closest_point(skin.corners, np.zeros((len(skin.triangles), 3)))
    away = float(np.linalg.norm(nearest, axis=1).min())
    pad = lowest_height(0.0, 0.0, skin.corners) or 0.0
    if pad < -_REACH_MM and away <= _REACH_MM:
        raise PlaceError(
            f"{contact} lies {-pad:.1f} mm above the pad, on the side of the nail: {remedy}", place
        )
    if away > _REACH_MM:
        raise PlaceError(f"{contact} lies {away:.1f} mm from the scanned skin: {remedy}", place)


def _guess(skin: Triangles, finger: Finger, tip: float, cut: float) -> Capsule:
    """Return a capsule as wide and high as a scan; raise MeshError if that is no finger's size."""
    import trimesh  # takes 0.15 s

    # Triangles may be longer than the finger.
    points, _ = trimesh.remesh.subdivide_to_size(skin.points, skin.triangles, _EDGE_MM, 30)
    shaft = points[(points[:, 1] > cut) & (points[:, 1] < 0.5 * tip)]
    low, high = shaft.min(axis=0), shaft.max(axis=0)
    width, _, height = high - low
    if max(width, height) > _LARGEST_WIDTH_MM:
        raise MeshError(
            f"finger.skin_file is {width:.0f} mm wide and {height:.0f} mm high within the "
            f"finger's length of {tip - cut:g} mm, at most {_LARGEST_WIDTH_MM:g} mm are a finger: "
            "give contact_mm, tip_direction and nail_direction of one finger, or cut it out"
        )
    return Capsule(
        half_width=width / 2,
        below=0.55 * height,
        above=0.45 * height,
        axis_z=low[2] + 0.55 * height,
        tip_y=tip,
        tip_length=min(finger.tip_length_mm, tip),
        cut_y=cut,
        pad_radius=100.0,
        fullness=1.0,
    )


_FITTED = ("half_width", "below", "above", "axis_z", "tip_length", "pad_radius", "fullness")


def _fitted(guess: Capsule, surface: SmoothSurface) -> Capsule:
    """Return the capsule whose samples are nearest to a surface."""
    start = np.array([getattr(guess, name) for name in _FITTED])
    steepest = -guess.cut_y / np.sin(ARC_END)  # an arc that ends at the cut at the latest
    least = [*(0.5 * start[:3]), start[3] - 3, 0.3 * start[4], min(0.5 * steepest, 15.0), 0.3]
    most = [*(1.5 * start[:3]), start[3] + 3, guess.tip_y, 300.0, 1.85]
    start = np.clip(start, np.array(least) + 1e-6, np.array(most) - 1e-6)

    def misfit(values: Array) -> Array:
        capsule = replace(guess, **dict(zip(_FITTED, values.tolist(), strict=True)))
        return surface.level(capsule.place(guess.reference(_FIT_STEP_MM))[0])

    found = least_squares(misfit, start, bounds=(least, most), x_scale=start)
    return replace(guess, **dict(zip(_FITTED, found.x.tolist(), strict=True)))
