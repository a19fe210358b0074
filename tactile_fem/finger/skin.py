"""Triangulation of a capsule (skin or bone), refined at the contact patch."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import Array, Capsule, Skin

PATCH_MM = (4.5, 6.0)  # half width (X) and half length (Y) of the finely meshed patch
NAIL_FROM_TIP_MM = 1.0

Size = Callable[[float, float, float], float]


@dataclass(frozen=True)
class Sizes:
    """Edge lengths in mm at the contact patch, far from it and on the bone, and their growth.

    At a distance a from the patch the edge length is pad + growth a + curve a^2, at most far.
    """

    pad: float
    far: float
    bone: float
    growth: float
    curve: float
    epidermis_rows: int


PRESETS = {
    "coarse": Sizes(1.0, 4.5, 3.2, 0.3, 0.3, 2),
    "medium": Sizes(0.56, 2.8, 2.4, 0.3, 0.1, 2),
    "paper": Sizes(0.33, 1.5, 1.4, 0.2, 0.0, 2),
}


def sizes_of(finger: Finger) -> Sizes:
    """Return the preset's sizes, overridden by the finger's own values."""
    preset = PRESETS[finger.preset]
    pad = finger.pad_size_mm or preset.pad
    far = finger.far_size_mm or max(preset.far, pad)
    if far < pad:
        raise MeshError(
            f"finger.far_size_mm = {far:g} must not be smaller than the edge under the contact "
            f"patch, {pad:g}"
        )
    bone = far * preset.bone / preset.far
    rows = finger.epidermis_rows or preset.epidermis_rows
    return Sizes(pad, far, bone, preset.growth, preset.curve, rows)


@dataclass(frozen=True)
class NailOutline:
    """Rounded rectangle in the XY plane (mm); the nail is its projection onto the dorsal side."""

    half_width: float
    start_y: float
    end_y: float

    @property
    def corner(self) -> float:
        """Radius of the corners."""
        return 0.9 * min(self.half_width, 0.5 * (self.end_y - self.start_y))

    @property
    def centres(self) -> tuple[float, float, float, float]:
        """Least X and Y, largest X and Y of the corners' centres."""
        x, r = self.half_width - self.corner, self.corner
        return -x, self.start_y + r, x, self.end_y - r

    @property
    def polygon(self) -> shapely.Polygon:
        """The outline."""
        return shapely.box(*self.centres).buffer(self.corner, quad_segs=16)


def nail_outline(
    finger: Finger, skin: Capsule, box: tuple[float, float, float] | None = None
) -> NailOutline:
    """Return the nail's outline.

    Parameters
    ----------
    finger, skin
        Lengths of the nail, shape of the skin.
    box
        Half width and ends in Y of a scanned nail, in place of the lengths.

    Raises
    ------
    MeshError
        The nail is wider or longer than the back of the finger.
    """
    end = skin.tip_y - NAIL_FROM_TIP_MM
    half_width, start, end = box or (0.5 * finger.nail_width_mm, end - finger.nail_length_mm, end)
    outline = NailOutline(half_width, start, end)
    size = f"the nail ({2 * half_width:.3g} mm wide, {end - start:.3g} mm long)"
    x, y = np.array(outline.polygon.exterior.coords).T
    t = np.clip((y - skin.shoulder_y) / skin.tip_length, 0.0, 1.0)
    room = skin.half_width * np.sqrt(1.0 - t**2)
    if np.any(np.abs(x) > 0.97 * room):
        raise MeshError(f"{size} does not fit on the back of the finger")
    if outline.start_y < skin.cut_y + 2.0:
        raise MeshError(f"{size} comes too near to the proximal cut")
    return outline


def pad_size(sizes: Sizes, capsule: Capsule) -> Size:
    """Return the edge length as a function of the position on the unbent capsule."""

    def size(x: float, y: float, z: float) -> float:
        across = max(abs(x) - PATCH_MM[0], 0.0)
        along = max(abs(y) - PATCH_MM[1], 0.0)
        above = max(z + 0.45 * capsule.below, 0.0)
        distance = math.sqrt(across**2 + along**2 + above**2)
        return min(sizes.pad + distance * (sizes.growth + sizes.curve * distance), sizes.far)

    return size


def bone_size(sizes: Sizes, finger: Finger) -> Size:
    """Return the bone's edge length; on its palmar side it follows the gap to the dermis."""
    near = min(sizes.bone, max(sizes.pad, 1.5 * finger.subcutaneous_mm))
    return lambda x, y, z: near if z < 0.0 else sizes.bone


def triangulate(
    skin: Skin, size: Size, outline: NailOutline | None = None
) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Triangulate a capsule, or one that was moved onto a scan.

    Parameters
    ----------
    skin
        The body.
    size
        Edge length in mm at x, y and the height above the axis, without the rise.
    outline
        Outline on the dorsal side that edges follow.

    Returns
    -------
    points, normals, triangles, under_nail
        (n, 3) in mm, (n, 3) outward unit normals, (m, 3) corners oriented outwards, (m,) whether
        a triangle lies inside the outline.
    """
    capsule = skin.capsule
    with gmsh_model() as gmsh:
        _add_capsule(gmsh, capsule, outline)
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, lc: size(x, y, z))
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.optimize("Relocate2D", niter=5)  # improves the pole of the tip
        gmsh.model.mesh.removeSizeCallback()
        raw, triangles, _ = simplices(gmsh, 2)
    points, normals = skin.place(raw / [capsule.half_width, 1.0, capsule.below])
    corner = points[triangles]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = np.einsum("ij,ij->i", area, normals[triangles].sum(axis=1)) < 0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    middle = raw[triangles].mean(axis=1)
    under_nail = np.zeros(len(triangles), dtype=bool)
    if outline is not None:
        inside = shapely.contains_xy(outline.polygon, middle[:, :2])
        under_nail = inside & (middle[:, 2] > 0)
    return points, normals, triangles, under_nail


def _add_capsule(gmsh: Any, capsule: Capsule, outline: NailOutline | None) -> None:
    """Add half an ellipsoid and an elliptic tube around Y, without the proximal lid."""
    occ = gmsh.model.occ
    width, height, shoulder = capsule.half_width, capsule.below, capsule.shoulder_y
    seam = 0.0 if outline is not None else math.pi / 2  # nodes align here: not on the pad
    cap = (3, occ.addSphere(0, 0, 0, 1, angle1=0, angle2=math.pi / 2))
    tube = (3, occ.addCylinder(0, 0, -1, 0, 0, 1, 1))
    occ.rotate([cap, tube], 0, 0, 0, 0, 0, 1, seam)
    occ.rotate([cap, tube], 0, 0, 0, 1, 0, 0, -math.pi / 2)
    occ.dilate([cap], 0, 0, 0, width, capsule.tip_length, height)
    occ.dilate([tube], 0, 0, 0, width, shoulder - capsule.cut_y, height)
    occ.translate([cap, tube], 0, shoulder, 0)
    occ.synchronize()
    skin = []
    for body in (cap, tube):
        for _, face in gmsh.model.getBoundary([body], oriented=False):
            low = gmsh.model.getBoundingBox(2, face)
            if low[4] - low[1] > 1e-3:  # the lids are flat
                skin.append((2, face))
    occ.remove([cap, tube])
    walls = [] if outline is None else _nail_walls(occ, outline, height)
    _, pieces = occ.fragment(skin, walls)
    keep = {piece for group in pieces[: len(skin)] for piece in group}
    occ.synchronize()
    occ.remove([face for face in gmsh.model.getEntities(2) if face not in keep], recursive=True)
    occ.synchronize()


def _nail_walls(occ: Any, outline: NailOutline, height: float) -> list[tuple[int, int]]:
    """Add upright walls along the outline."""
    left, near, right, far = outline.centres
    starts, ends, lines = [], [], []
    for quarter, centre in enumerate([(right, far), (left, far), (left, near), (right, near)]):
        turn = 0.5 * math.pi * quarter
        ring = [
            occ.addPoint(
                centre[0] + outline.corner * math.cos(a),
                centre[1] + outline.corner * math.sin(a),
                0,
            )
            for a in (turn, turn + 0.5 * math.pi)
        ]
        lines.append((1, occ.addCircleArc(ring[0], occ.addPoint(*centre, 0), ring[1])))
        starts.append(ring[0])
        ends.append(ring[1])
    for k in range(4):
        lines.append((1, occ.addLine(ends[k], starts[(k + 1) % 4])))
    return [entity for entity in occ.extrude(lines, 0, 0, 2.0 * height) if entity[0] == 2]
