"""A scanned bone: its smooth surface, closed before the cut, and its triangulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import Array
from tactile_fem.finger.smooth import SmoothSurface
from tactile_fem.runtime.triangles import Triangles

# A bone that ends here stays clear of the cut, so that it can be closed.
_FROM_CUT_MM = 1.5
# So much of it must lie in the finger.
_LEAST_LENGTH_MM = 2.0
# A scanned bone's largest triangles, over its least extent; tries with smaller ones.
_BONE_SIZE, _FINER = 0.25, 4
# Its triangles are evened out so often, and may be turned so far from the surface.
_EVENINGS, _LEAST_COSINE = 5, 0.2


@dataclass(frozen=True)
class ScannedBone:
    """A bone that ends before the cut.

    Attributes
    ----------
    surface
        Its smoothed surface.
    low, high
        Corners (3,) of its box.
    """

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

    def sample(self, step_mm: float) -> Array:
        """Return points (n, 3) of the surface about `step_mm` apart."""
        half = (self.high - self.low) / 2
        polar = np.linspace(-np.pi / 2, np.pi / 2, int(np.ceil(np.pi * half.max() / step_mm)))
        turn = np.arange(0.0, 2 * np.pi, step_mm / max(half[0], half[2]))
        polar, turn = (grid.ravel() for grid in np.meshgrid(polar, turn))
        unit = np.column_stack(
            [np.cos(polar) * np.cos(turn), np.sin(polar), np.cos(polar) * np.sin(turn)]
        )
        return self.surface.project((self.low + self.high) / 2 + half * unit)


def triangulate_bone(bone: ScannedBone, size_mm: float) -> tuple[Array, NDArray[np.int64]]:
    """Triangulate a closed bone: an ellipsoid as large as it, moved onto its surface.

    Parameters
    ----------
    bone
        Its surface.
    size_mm
        Largest edge; a slender or ragged bone gets smaller ones.

    Returns
    -------
    points, triangles
        (n, 3) in mm, (m, 3) corners oriented outwards.

    Raises
    ------
    MeshError
        Triangles fold.
    """
    size_mm = min(size_mm, _BONE_SIZE * float((bone.high - bone.low).min()))
    for _ in range(_FINER):
        points, triangles = _moved_ellipsoid(bone, size_mm)
        a, b, c = np.moveaxis(points[triangles], 1, 0)
        area = np.cross(b - a, c - a)
        outwards = np.einsum("ij,ij->i", area, bone.surface.normals((a + b + c) / 3))
        folded = outwards < _LEAST_COSINE * np.linalg.norm(area, axis=1)
        if not folded.any():
            return points, triangles
        size_mm /= 1.4
    raise PlaceError(
        "finger.bone_file: the bone is too ragged {place}: raise finger.smooth_mm",
        a[np.argmax(folded)],
    )


def _moved_ellipsoid(bone: ScannedBone, size_mm: float) -> tuple[Array, NDArray[np.int64]]:
    """Return points and triangles of an ellipsoid that was moved onto a bone and evened out."""
    middle, half = (bone.low + bone.high) / 2, (bone.high - bone.low) / 2
    with gmsh_model() as gmsh:
        occ = gmsh.model.occ
        ball = (3, occ.addSphere(0, 0, 0, 1))
        occ.dilate([ball], 0, 0, 0, *half)
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size_mm)
        gmsh.model.mesh.generate(2)
        points, triangles, _ = simplices(gmsh, 2)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    triangles[inwards] = triangles[inwards][:, [0, 2, 1]]
    points = bone.surface.project(points + middle)
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    for _ in range(_EVENINGS):
        around = np.zeros_like(points)
        np.add.at(around, edges[:, 0], points[edges[:, 1]])
        points = bone.surface.project(around / np.bincount(edges[:, 0])[:, None])
    return points, triangles
