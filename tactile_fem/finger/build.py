"""Meshes a finger that no file has.

The skin of a solid finger is triangulated and extruded inwards to prisms of three tetrahedra; gmsh
fills the rest. A section is meshed in `tactile_fem.finger.section`.
"""

from __future__ import annotations

import logging
import math
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.finger.anatomy import Anatomy, NailOutline, Skin
from tactile_fem.finger.layers import CUT_BLEND_MM, Size, extrude, extrusion_directions
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, edges_per_ridge
from tactile_fem.finger.plane import Array
from tactile_fem.finger.section import section_cells
from tactile_fem.finger.session import fill_plane, fill_volume, gmsh_model, simplices
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.shape import Capsule
from tactile_fem.finger.simplex import Indices, Triangles, facets_of, quadratic

logger = logging.getLogger(__name__)

_LEAST_CUT_HEIGHT_MM = 2.5  # of the skin at the cut
_LEAST_DEPTH_SHARE = 0.7  # of the thickness of the layers: how far their inner limit lies inside


def build_finger(finger: FingerSettings) -> FingerMesh:
    """Mesh a finger; the same parameters give the same mesh.

    Raises
    ------
    MeshError
        The lengths do not make a finger, or gmsh is missing or fails.
    """
    anatomy = Anatomy.of(finger)
    make_cells = section_cells if finger.is_section else _solid_cells
    nodes, (layers, tissue), fat, marrow = make_cells(anatomy)
    cells = np.concatenate([layers, fat, marrow])
    tags = [np.full(len(fat), TISSUES["subcutaneous"]), np.full(len(marrow), TISSUES["bone"])]
    tissue = np.concatenate([tissue, *tags])
    facets, surface = _tagged_surfaces(nodes, cells, tissue, anatomy.skin.capsule.cut_y)
    nodes, cells, facets = quadratic(nodes, cells, facets)
    mesh = FingerMesh(nodes, cells, tissue, facets, surface)
    mesh.check()
    logger.info("finger with %d %s and %d nodes", len(cells), mesh.simplex.plural, len(nodes))
    if edges := edges_per_ridge(mesh, finger):
        logger.info("%.1f edges to a ridge of %g mm", edges, finger.ridge_pitch_mm)
    return mesh


def _tagged_surfaces(
    nodes: Array, cells: Indices, tissue: Indices, cut_y: float
) -> tuple[Indices, Indices]:
    """Return the tagged facets (k, d) and tags (k,), which follow from the adjacent tissues."""
    facets, first, second = facets_of(cells)
    one = tissue[first]
    other = np.where(second < 0, 0, tissue[second])
    low, high = np.minimum(one, other), np.maximum(one, other)
    on_cut = np.all(np.abs(nodes[facets, 1] - cut_y) < 1e-6, axis=1)
    tag = np.zeros(len(facets), dtype=np.int64)
    tag[(low == 0) & (high == TISSUES["stratum_corneum"])] = SURFACES["skin"]
    tag[(low == TISSUES["epidermis"]) & (high == TISSUES["dermis"])] = SURFACES["interface"]
    tag[(low != high) & (high == TISSUES["bone"])] = SURFACES["bone_surface"]
    tag[(low == 0) & on_cut] = SURFACES["cut"]
    chosen = np.flatnonzero(tag)
    chosen = chosen[np.argsort(tag[chosen], kind="stable")]
    return facets[chosen], tag[chosen]


def _solid_cells(anatomy: Anatomy) -> tuple[Array, tuple[Indices, Indices], Indices, Indices]:
    """Return nodes (n, 3); tetrahedra (m, 4) of the layers, their tissues (m,); of fat; of bone."""
    skin, cut_y = anatomy.skin, anatomy.skin.capsule.cut_y
    size = anatomy.sizes.on_skin(skin.capsule)
    outer, normals, under_nail = triangulate(skin, size, anatomy.nail)
    lift = outer.points[outer.points[:, 1] < cut_y + 1e-6, 2].min()
    if lift < _LEAST_CUT_HEIGHT_MM:  # a flat stimulator might touch it
        logger.warning("the skin rises only %.1f mm from the contact point to the cut", lift)
    directions = extrusion_directions(outer.points, normals, cut_y)
    nodes, cells, tissue = extrude(outer, directions, under_nail, anatomy.rows)
    first = len(nodes) - len(outer.points)
    if not isinstance(skin, Capsule):  # its lengths have been checked
        _check_room(skin, nodes[first:], anatomy.rows.depths[-1])
    nodes, fat, marrow = _fill(nodes, outer.triangles + first, anatomy)
    return nodes, (cells, tissue), fat, marrow


def _check_room(skin: Skin, inner: Array, depth: float) -> None:
    """Raise PlaceError if the layers, extruded from several sides, meet inside a finger."""
    clear = inner[:, 1] > skin.capsule.cut_y + CUT_BLEND_MM
    room = np.where(clear, -skin.level(inner), depth)
    worst = int(np.argmin(room))
    if room[worst] < _LEAST_DEPTH_SHARE * depth:
        raise PlaceError(
            f"the finger is too thin or too sharply bent for layers of {depth:.2f} mm {{place}}: "
            "use thinner layers or a larger smooth_mm",
            inner[worst],
        )


def _fill(nodes: Array, inner: Indices, anatomy: Anatomy) -> tuple[Array, Indices, Indices]:
    """Fill the inside of the skin; return the nodes and the tetrahedra of fat and bone."""
    sizes = anatomy.sizes
    if not isinstance(anatomy.bone, Capsule):  # ends before the cut
        bone = anatomy.bone.triangulated(sizes.bone)
        surface = bone.triangles + len(nodes)
        nodes, lid = fill_plane(np.vstack([nodes, bone.points]), [_rim(inner)], sizes.far)
        nodes, fat = fill_volume(nodes, [inner, lid], [surface], improve=True)
        nodes, marrow = fill_volume(nodes, [surface])
    else:
        bone, _, _ = triangulate(anatomy.bone, sizes.on_bone(anatomy.finger))
        surface = bone.triangles + len(nodes)
        loops = [_rim(inner), _rim(surface)]
        nodes, annulus = fill_plane(np.vstack([nodes, bone.points]), loops, sizes.far)
        nodes, disc = fill_plane(nodes, loops[1:], sizes.far)
        nodes, fat = fill_volume(nodes, [inner, surface, annulus], improve=True)
        nodes, marrow = fill_volume(nodes, [surface, disc])
    return nodes, fat, marrow


def _rim(triangles: Indices) -> Indices:
    """Return the nodes (n,) around the only hole of a triangulation, in order."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    inside = {(b, a) for a, b in edges.tolist()}
    following = {a: b for a, b in edges.tolist() if (a, b) not in inside}
    if not following:
        raise MeshError("the triangulated surface has no open end at the cut")
    loop = [min(following)]
    while len(loop) < len(following):
        loop.append(following[loop[-1]])
    if len(set(loop)) != len(following) or following[loop[-1]] != loop[0]:
        raise MeshError("the triangulated surface is open elsewhere than at the cut")
    return np.array(loop)


def triangulate(
    skin: Skin, size: Size, outline: NailOutline | None = None
) -> tuple[Triangles, Array, NDArray[np.bool_]]:
    """Triangulate a capsule, or a skin that one is moved onto.

    `size` is the edge length in mm at x, y and the height above the axis, without the rise; edges
    follow the nail's outline. Return m triangles that face outwards, unit normals of the body at
    their points (n, 3), and whether a triangle lies inside the outline, (m,).
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
    middle = raw[triangles].mean(axis=1)
    under_nail = np.zeros(len(triangles), dtype=bool)
    if outline is not None:
        import shapely  # takes a while

        inside = shapely.contains_xy(outline.polygon, middle[:, :2])
        under_nail = inside & (middle[:, 2] > 0)
    surface = Triangles(points, triangles).facing(normals[triangles].sum(axis=1))
    return surface, normals, under_nail


def _add_capsule(gmsh: ModuleType, capsule: Capsule, outline: NailOutline | None) -> None:
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
    rings, lines, r = [], [], outline.corner
    for quarter, (x, y) in enumerate([(right, far), (left, far), (left, near), (right, near)]):
        turns = 0.5 * math.pi * quarter, 0.5 * math.pi * quarter + 0.5 * math.pi
        rings.append([occ.addPoint(x + r * math.cos(a), y + r * math.sin(a), 0) for a in turns])
        start, end = rings[-1]
        lines.append((1, occ.addCircleArc(start, occ.addPoint(x, y, 0), end)))
    for (_, end), (start, _) in pairwise([*rings, rings[0]]):
        lines.append((1, occ.addLine(end, start)))
    return [entity for entity in occ.extrude(lines, 0, 0, 2.0 * height) if entity[0] == 2]
