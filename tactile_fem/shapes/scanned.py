"""Scanned skin and bone: smoothed, and triangulated as the analytic ones are.

A scanned skin is a capsule that is moved along its normals onto the smoothed scan, and a bone an
ellipsoid. So their triangles have the wanted size, whatever those of the files are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.finger import (
    ARC_END,
    Capsule,
    FingerSettings,
    gmsh_model,
    lowest_height,
    simplices,
)
from tactile_fem.shapes.scans import Frame, beyond, connected
from tactile_fem.shapes.smooth import SmoothSurface
from tactile_fem.shapes.surface_files import Array, Triangles

# Of the skin.
_SCAN_BEYOND_CUT_MM = 1.0  # length of the scan beyond the cut, where it may be open
_REACH_MM = 3.0  # by which the capsule is moved at most
_CONTACT_FROM_CUT_MM, _CONTACT_FROM_TIP_MM = 3.0, 1.0
_LARGEST_WIDTH_MM, _EDGE_MM = 45.0, 3.0  # edges from which the width is measured
_FIT_STEP_MM, _LOWEST_STEP_MM = 1.5, 0.25  # between samples, to fit and to find the lowest point
# Of the bone.
_BONE_TO_CUT_MM = 1.5  # a bone that ends here is clear of the cut, so that it can be closed
_LEAST_BONE_LENGTH_MM = 2.0  # in the finger
# The largest triangles over the least extent of the bone; each further attempt makes them smaller.
_SIZE_SHARE, _ATTEMPTS, _REFINEMENT = 0.25, 4, 1.4
_SMOOTHINGS = 5  # of the triangulation
_LEAST_COSINE = 0.2  # of the angle between a triangle and the surface


@dataclass(frozen=True)
class ScannedSkin:
    """A capsule that is moved along its normals onto a smoothed scan."""

    capsule: Capsule
    surface: SmoothSurface

    @classmethod
    def of(cls, skin: Triangles, finger: FingerSettings, frame: Frame) -> ScannedSkin:
        """Fit the capsule to a scan; MeshError if it is too short, has a hole, is no finger ..."""
        length = finger.tip_length_mm + finger.straight_length_mm
        whole, skin = skin, beyond(skin, -length - _SCAN_BEYOND_CUT_MM - _REACH_MM)
        if skin is not whole:  # fingers of one hand are apart here
            skin = connected(skin, np.zeros(3))
        tip = float(skin.points[:, 1].max())
        cut = tip - length
        _check_contact(skin, finger, frame, cut, tip)
        _check_length(skin, cut)
        skin = beyond(skin, cut - _SCAN_BEYOND_CUT_MM - _REACH_MM)
        _check_holes(skin, cut)
        guess = _guess(skin, finger, tip, cut)
        surface = SmoothSurface.of(
            skin, finger.smooth_mm, "finger.skin_file", cut - _SCAN_BEYOND_CUT_MM, closed=False
        )
        return cls(_fitted(guess, surface), surface)

    def place(self, reference: Array) -> tuple[Array, Array]:
        """Move points of the reference capsule onto the scan, as `Capsule.place` does."""
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
    if first > cut - _SCAN_BEYOND_CUT_MM:
        last = float(skin.points[:, 1].max())
        raise MeshError(
            f"finger.skin_file is {last - first:.1f} mm long, but tip_length_mm and "
            f"straight_length_mm ask for {last - cut:.1f} mm and {_SCAN_BEYOND_CUT_MM:g} mm more: "
            "shorten straight_length_mm, or correct tip_direction"
        )


def _check_holes(skin: Triangles, cut: float) -> None:
    pairs, count = np.unique(np.sort(skin.edges(), axis=1), axis=0, return_counts=True)
    middle = skin.points[pairs[count == 1]].mean(axis=1)
    inside = middle[middle[:, 1] > cut - _SCAN_BEYOND_CUT_MM]
    if len(inside):
        raise PlaceError(
            "finger.skin_file has a hole {place}: close it (only its proximal end may be open)",
            inside[0],
        )


def _check_contact(
    skin: Triangles, finger: FingerSettings, frame: Frame, cut: float, tip: float
) -> None:
    """Raise PlaceError if the origin is no point of a pad between the cut and the tip."""
    import trimesh  # takes 0.15 s

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
    nearest = trimesh.triangles.closest_point(skin.corners, np.zeros((len(skin.triangles), 3)))
    away = float(np.linalg.norm(nearest, axis=1).min())
    pad = lowest_height(0.0, 0.0, skin.corners) or 0.0
    if not least <= tip <= most:
        problem = (
            f"lies {tip:.1f} mm behind the tip, but it must lie {least:g} to {most:g} mm behind "
            f"it, as the finger is cut at tip_length_mm + straight_length_mm = {tip - cut:g} mm"
        )
    elif away > _REACH_MM:
        problem = f"lies {away:.1f} mm from the scanned skin"
    elif pad < -_REACH_MM:
        problem = f"lies {-pad:.1f} mm above the pad, on the side of the nail"
    else:
        return
    raise PlaceError(f"{contact} {problem}: {remedy}", np.zeros(3))


def _guess(skin: Triangles, finger: FingerSettings, tip: float, cut: float) -> Capsule:
    """Return a capsule as wide and high as a scan; raise MeshError if no finger is so large."""
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


_FIT_PARAMETERS = ("half_width", "below", "above", "axis_z", "tip_length", "pad_radius", "fullness")


def _fitted(guess: Capsule, surface: SmoothSurface) -> Capsule:
    """Return the capsule whose samples are nearest to a surface."""
    from scipy.optimize import least_squares  # takes a while

    start = np.array([getattr(guess, name) for name in _FIT_PARAMETERS])
    steepest = -guess.cut_y / np.sin(ARC_END)  # an arc that ends at the cut at the latest
    least = [*(0.5 * start[:3]), start[3] - 3, 0.3 * start[4], min(0.5 * steepest, 15.0), 0.3]
    most = [*(1.5 * start[:3]), start[3] + 3, guess.tip_y, 300.0, 1.85]
    start = np.clip(start, np.array(least) + 1e-6, np.array(most) - 1e-6)

    def misfit(values: Array) -> Array:
        capsule = replace(guess, **dict(zip(_FIT_PARAMETERS, values.tolist(), strict=True)))
        return surface.level(capsule.place(guess.reference(_FIT_STEP_MM))[0])

    found = least_squares(misfit, start, bounds=(least, most), x_scale=start)
    return replace(guess, **dict(zip(_FIT_PARAMETERS, found.x.tolist(), strict=True)))


# --- bone ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ScannedBone:
    """A smoothed bone that ends before the cut, and the corners (3,) of its box."""

    surface: SmoothSurface
    low: Array
    high: Array

    @classmethod
    def of(cls, bone: Triangles, finger: FingerSettings, cut_y: float) -> ScannedBone:
        """Smooth a bone and end it before the cut; MeshError if it lies behind that."""
        end = cut_y + _BONE_TO_CUT_MM
        low, high = bone.points.min(axis=0), bone.points.max(axis=0)
        if high[1] < end + _LEAST_BONE_LENGTH_MM:
            raise MeshError(
                f"finger.bone_file: the bone ends at Y {high[1]:.1f} mm in the finger's axes, but "
                f"the finger is cut at {cut_y:.1f} mm"
            )
        low = np.maximum(low, [-np.inf, end, -np.inf])
        surface = SmoothSurface.of(bone, finger.smooth_mm, "finger.bone_file", end, closed=True)
        return cls(surface, low, high)

    def sample(self, step_mm: float) -> tuple[Array, Array]:
        """Return points (n, 3) of the surface about `step_mm` apart and their normals."""
        half = (self.high - self.low) / 2
        polar = np.linspace(-np.pi / 2, np.pi / 2, int(np.ceil(np.pi * half.max() / step_mm)))
        turn = np.arange(0.0, 2 * np.pi, step_mm / max(half[0], half[2]))
        polar, turn = (grid.ravel() for grid in np.meshgrid(polar, turn))
        unit = np.column_stack(
            [np.cos(polar) * np.cos(turn), np.sin(polar), np.cos(polar) * np.sin(turn)]
        )
        points = self.surface.project((self.low + self.high) / 2 + half * unit)
        return points, self.surface.normals(points)

    def triangulated(self, size_mm: float) -> Triangles:
        """Triangulate it: an ellipsoid as large as it, moved onto its surface.

        `size_mm` is the largest edge; a slender or ragged bone gets smaller ones. Raises MeshError
        if triangles fold nevertheless.
        """
        size_mm = min(size_mm, _SIZE_SHARE * float((self.high - self.low).min()))
        for _ in range(_ATTEMPTS):
            found = _moved_ellipsoid(self, size_mm)
            vectors, corners = found.area_vectors, found.corners
            outwards = np.einsum("ij,ij->i", vectors, self.surface.normals(corners.mean(axis=1)))
            folded = outwards < _LEAST_COSINE * np.linalg.norm(vectors, axis=1)
            if not folded.any():
                return found
            size_mm /= _REFINEMENT
        raise PlaceError(
            "finger.bone_file: the bone is too ragged {place}: raise finger.smooth_mm",
            corners[np.argmax(folded), 0],
        )


def _moved_ellipsoid(bone: ScannedBone, size_mm: float) -> Triangles:
    """Return the triangles of an ellipsoid, moved onto a bone and smoothed there."""
    middle, half = (bone.low + bone.high) / 2, (bone.high - bone.low) / 2
    with gmsh_model() as gmsh:
        occ = gmsh.model.occ
        ball = (3, occ.addSphere(0, 0, 0, 1))
        occ.dilate([ball], 0, 0, 0, *half)
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size_mm)
        gmsh.model.mesh.generate(2)
        points, triangles, _ = simplices(gmsh, 2)
    ellipsoid = Triangles(points, triangles)
    triangles = ellipsoid.facing(ellipsoid.corners.mean(axis=1)).triangles
    points = bone.surface.project(points + middle)
    edges = Triangles(points, triangles).edges()
    for _ in range(_SMOOTHINGS):
        around = np.zeros_like(points)
        np.add.at(around, edges[:, 0], points[edges[:, 1]])
        points = bone.surface.project(around / np.bincount(edges[:, 0])[:, None])
    return Triangles(points, triangles)
