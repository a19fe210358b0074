"""A scanned bone: its smooth surface, closed before the cut, and its triangulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.finger.plane import Array
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.simplex import Indices
from tactile_fem.finger.smooth import SmoothSurface
from tactile_fem.runtime.triangles import Triangles

_FROM_CUT_MM = 1.5  # a bone that ends here is clear of the cut, so that it can be closed
_LEAST_LENGTH_MM = 2.0  # in the finger
# The largest triangles over the bone's least extent; each further attempt makes them smaller.
_SIZE_SHARE, _ATTEMPTS, _REFINEMENT = 0.25, 4, 1.4
_SMOOTHINGS = 5  # of the triangulation
_LEAST_COSINE = 0.2  # of the angle between a triangle and the surface


@dataclass(frozen=True)
class ScannedBone:
    """A smoothed bone that ends before the cut, and the corners (3,) of its box."""

    surface: SmoothSurface
    low: Array
    high: Array

    @classmethod
    def of(cls, bone: Triangles, finger: Finger, cut_y: float) -> ScannedBone:
        """Smooth a bone and end it before the cut.

        Raises
        ------
        MeshError
            It lies behind the cut, or intersects itself.
        """
        end = cut_y + _FROM_CUT_MM
        low, high = bone.points.min(axis=0), bone.points.max(axis=0)
        if high[1] < end + _LEAST_LENGTH_MM:
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


def triangulate_bone(bone: ScannedBone, size_mm: float) -> Triangles:
    """Triangulate a closed bone: an ellipsoid as large as it, moved onto its surface.

    `size_mm` is the largest edge; a slender or ragged bone gets smaller ones.

    Raises
    ------
    MeshError
        Triangles fold.
    """
    size_mm = min(size_mm, _SIZE_SHARE * float((bone.high - bone.low).min()))
    for _ in range(_ATTEMPTS):
        found = _moved_ellipsoid(bone, size_mm)
        vectors, corners = found.area_vectors, found.corners
        outwards = np.einsum("ij,ij->i", vectors, bone.surface.normals(corners.mean(axis=1)))
        folded = outwards < _LEAST_COSINE * np.linalg.norm(vectors, axis=1)
        if not folded.any():
            return found
        size_mm /= _REFINEMENT
    raise PlaceError(
        "finger.bone_file: the bone is too ragged {place}: raise finger.smooth_mm",
        corners[np.argmax(folded), 0],
    )


def _moved_ellipsoid(bone: ScannedBone, size_mm: float) -> Triangles:
    """Return an ellipsoid's triangles that were moved onto a bone and smoothed there."""
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
    edges: Indices = Triangles(points, triangles).edges()
    for _ in range(_SMOOTHINGS):
        around = np.zeros_like(points)
        np.add.at(around, edges[:, 0], points[edges[:, 1]])
        points = bone.surface.project(around / np.bincount(edges[:, 0])[:, None])
    return Triangles(points, triangles)
