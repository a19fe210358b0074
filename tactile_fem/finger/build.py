"""Meshes the parametric finger.

The skin is triangulated and extruded inwards to prisms of three tetrahedra; gmsh fills the rest.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.finger.anatomy import Anatomy
from tactile_fem.finger.bone import ScannedBone, triangulate_bone
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, facets_of, quadratic
from tactile_fem.finger.report import check_mesh
from tactile_fem.finger.scanned import ScannedSkin
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import Array, Capsule
from tactile_fem.finger.skin import (
    Sizes,
    bone_size,
    pad_size,
    sizes_of,
    triangulate,
)

logger = logging.getLogger(__name__)

Triangles = NDArray[np.int64]
CUT_BLEND_MM = 4.0  # over this length the extrusion turns into the plane of the cut
_LEAST_LIFT_MM = 2.5  # of the skin at the cut
_LEAST_SHARE = 0.7  # of the layers' depth that their inner limit is at least below the skin


def build_finger(finger: Finger) -> FingerMesh:
    """Mesh the parametric finger; the same parameters give the same mesh.

    Raises
    ------
    MeshError
        If the lengths do not make a finger, or gmsh is missing or fails.
    """
    sizes = sizes_of(finger)
    rows = layering(finger, sizes.epidermis_rows)
    anatomy = Anatomy.of(finger)
    skin, cut_y = anatomy.skin, anatomy.skin.capsule.cut_y
    outer_size = pad_size(sizes, skin.capsule)
    points, normals, outer, under_nail = triangulate(skin, outer_size, anatomy.nail)
    _warn_of_low_cut(points, cut_y)
    directions = extrusion_directions(points, normals, cut_y)
    nodes, tets, tissue = extrude(points, directions, outer, under_nail, rows)
    inner = outer + len(nodes) - len(points)
    _check_room(skin, nodes[-len(points) :], rows.depths[-1], cut_y)
    nodes, fat, marrow = _fill(nodes, inner, anatomy.bone, sizes, finger)
    return put_together(nodes, (tets, tissue), fat, marrow, cut_y)


def put_together(
    nodes: Array,
    layers: tuple[NDArray[np.int64], NDArray[np.int64]],
    fat: NDArray[np.int64],
    marrow: NDArray[np.int64],
    cut_y: float,
) -> FingerMesh:
    """Return the quadratic mesh of linear cells: those of the layers with their tissues, fat, bone.

    Raises
    ------
    MeshError
        They cannot be used.
    """
    cells = np.concatenate([layers[0], fat, marrow])
    tissue = np.concatenate(
        [
            layers[1],
            np.full(len(fat), TISSUES["subcutaneous"]),
            np.full(len(marrow), TISSUES["bone"]),
        ]
    )
    facets, surface = tag_surfaces(nodes, cells, tissue, cut_y)
    nodes, cells, facets = quadratic(nodes, cells, facets)
    mesh = FingerMesh(nodes, cells, tissue, facets, surface)
    check_mesh(mesh)
    logger.info("finger of %d %s and %d nodes", len(cells), mesh.simplex.plural, len(nodes))
    return mesh


def _warn_of_low_cut(skin_points: Array, cut_y: float) -> None:
    """Warn if the skin at the cut is so low that a flat stimulator might touch it."""
    lift = skin_points[skin_points[:, 1] < cut_y + 1e-6, 2].min()
    if lift < _LEAST_LIFT_MM:
        logger.warning("the skin rises only %.1f mm from the contact point to the cut", lift)


def _check_room(skin: Capsule | ScannedSkin, inner: Array, depth: float, cut_y: float) -> None:
    """Raise MeshError if the layers, extruded from several sides, meet inside a scanned finger."""
    if isinstance(skin, Capsule):
        return  # `layering` and `bone_shape` have seen to it
    clear = inner[:, 1] > cut_y + CUT_BLEND_MM
    room = np.where(clear, -skin.level(inner), depth)
    worst = int(np.argmin(room))
    if room[worst] < _LEAST_SHARE * depth:
        raise PlaceError(
            f"the finger is too thin or too sharply bent for layers of {depth:.2f} mm {{place}}: "
            "use thinner layers or a larger smooth_mm",
            inner[worst],
        )


def _fill(
    nodes: Array, inner: Triangles, bone: Capsule | ScannedBone, sizes: Sizes, finger: Finger
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Fill the inside of the skin; return the nodes and the tetrahedra of fat and bone."""
    reaches_the_cut = isinstance(bone, Capsule)
    if reaches_the_cut:
        bone_points, _, bone_triangles, _ = triangulate(bone, bone_size(sizes, finger))
    else:
        bone_points, bone_triangles = triangulate_bone(bone, sizes.bone)
    bone_triangles = bone_triangles + len(nodes)
    nodes = np.vstack([nodes, bone_points])
    inner_loop = _rim(inner)
    if reaches_the_cut:
        bone_loop = _rim(bone_triangles)
        nodes, annulus = fill_plane(nodes, [inner_loop, bone_loop], sizes.far)
        nodes, disc = fill_plane(nodes, [bone_loop], sizes.far)
        nodes, fat = _fill_volume(nodes, [inner, bone_triangles, annulus], improve=True)
        nodes, marrow = _fill_volume(nodes, [bone_triangles, disc])
    else:
        nodes, lid = fill_plane(nodes, [inner_loop], sizes.far)
        nodes, fat = _fill_volume(nodes, [inner, lid], [bone_triangles], improve=True)
        nodes, marrow = _fill_volume(nodes, [bone_triangles])
    return nodes, fat, marrow


def tag_surfaces(
    nodes: Array, tets: NDArray[np.int64], tissue: NDArray[np.int64], cut_y: float
) -> tuple[Triangles, NDArray[np.int64]]:
    """Return the tagged facets (k, 3) and tags (k,), which follow from the adjacent tissues."""
    facets, first, second = facets_of(tets)
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


def _rim(triangles: Triangles) -> NDArray[np.int64]:
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


def fill_plane(
    nodes: Array, loops: list[NDArray[np.int64]], size: float
) -> tuple[Array, Triangles]:
    """Triangulate the cut plane inside the first loop and outside the second."""
    with gmsh_model() as gmsh:
        geo = gmsh.model.geo
        known = np.concatenate(loops)
        for tag in known:
            geo.addPoint(*nodes[tag], tag=int(tag) + 1)
        wires = []
        for loop in loops:
            lines = [
                geo.addLine(int(a) + 1, int(b) + 1)
                for a, b in zip(loop, np.roll(loop, -1), strict=True)
            ]
            wires.append(geo.addCurveLoop(lines))
            for line in lines:
                geo.mesh.setTransfiniteCurve(line, 2)
        geo.addPlaneSurface(wires)
        geo.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(2)
        # The number of a point's mesh node differs from that of the point.
        number = {}
        for tag in known:
            ((node,), _, _) = gmsh.model.mesh.getNodes(0, int(tag) + 1)
            number[int(node)] = int(tag)
        return _read(gmsh, nodes, number, 2)


def _fill_volume(
    nodes: Array,
    shell: list[Triangles],
    holes: Sequence[Triangles] = (),
    *,
    improve: bool = False,
) -> tuple[Array, NDArray[np.int64]]:
    """Fill a closed shell around closed holes with tetrahedra.

    `improve` removes slivers and adds a few cells.
    """
    with gmsh_model() as gmsh:
        mesh = gmsh.model.mesh
        surfaces = [*shell, *holes]
        known = np.unique(np.concatenate(surfaces))
        faces = [gmsh.model.addDiscreteEntity(2) for _ in surfaces]
        mesh.addNodes(2, faces[0], known + 1, nodes[known].ravel())
        for face, triangles in zip(faces, surfaces, strict=True):
            mesh.addElementsByType(face, 2, [], (triangles + 1).ravel())
        loops = [faces[: len(shell)], *([face] for face in faces[len(shell) :])]
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(loop) for loop in loops])
        gmsh.model.geo.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        mesh.generate(3)
        if improve:  # with gmsh's own optimizer if it was built without Netgen, as in Debian
            has_netgen = "Netgen" in gmsh.option.getString("General.BuildOptions")
            mesh.optimize("Netgen" if has_netgen else "", force=True)
        return _read(gmsh, nodes, {int(k) + 1: int(k) for k in known}, 3)


def _read(
    gmsh: ModuleType, nodes: Array, number: dict[int, int], dim: Literal[2, 3]
) -> tuple[Array, NDArray[np.int64]]:
    """Append gmsh's new nodes and return the elements in our numbering."""
    points, cells, tags = simplices(gmsh, dim)
    if len(cells) == 0:
        raise MeshError("gmsh left a part of the finger empty: bone and skin may be too near")
    numbers = np.array([number.get(tag, -1) for tag in tags.tolist()])
    new = numbers < 0
    numbers[new] = len(nodes) + np.arange(new.sum())
    return np.vstack([nodes, points[new]]), numbers[cells]


# --- layers of skin ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Layering:
    """Depths (r + 1,) in mm that bound the rows, and the tissue tag (r,) of each row.

    Under the nail's outline the first `nail_rows` rows belong to the nail.
    """

    depths: Array
    tissue: NDArray[np.int64]
    nail_rows: int


def layering(finger: Finger, epidermis_rows: int) -> Layering:
    """Divide the layers into rows; the underside of the nail is one of the boundaries.

    If a boundary within the epidermis is close to the underside of the nail, it is moved there;
    otherwise a row is divided there.

    Raises
    ------
    MeshError
        The layers are thicker than the pad, or the nail is thicker than the layers.
    """
    corneum = finger.stratum_corneum_mm
    dermis_top = corneum + finger.epidermis_mm
    bottom = dermis_top + finger.dermis_mm
    nail = finger.nail_thickness_mm
    if nail >= bottom - 0.05:
        raise MeshError(
            f"finger.nail_thickness_mm = {nail:g} must be less than the layers of skin, "
            f"{bottom:g} mm"
        )
    if bottom >= 0.5 * min(finger.half_width_mm, finger.dorsal_height_mm):
        raise MeshError(
            f"the layers of skin ({bottom:g} mm) are too thick for a finger of half width "
            f"{finger.half_width_mm:g} mm and dorsal height {finger.dorsal_height_mm:g} mm"
        )
    depths = [0.0, *np.linspace(corneum, dermis_top, epidermis_rows + 1), bottom]
    fixed = {0.0, corneum, dermis_top, bottom}
    near = min(depths[1:-1], key=lambda depth: abs(depth - nail))
    row = finger.epidermis_mm / epidermis_rows
    if abs(near - nail) > 1e-6:
        if near not in fixed and abs(near - nail) < 0.4 * row:
            depths.remove(near)
        depths.append(nail)
    limits = np.array(sorted(depths))
    middle = 0.5 * (limits[1:] + limits[:-1])
    names = np.array([TISSUES[name] for name in ("stratum_corneum", "epidermis", "dermis")])
    tissue = names[np.searchsorted([corneum, dermis_top], middle)]
    return Layering(limits, tissue, int(np.searchsorted(limits, nail - 1e-6)))


def extrusion_directions(points: Array, normals: Array, cut_y: float) -> Array:
    """Return directions (n, 3) with unit normal component, in the cut plane at the cut."""
    t = np.clip((points[:, 1] - cut_y) / CUT_BLEND_MM, 0.0, 1.0)
    directions = normals.copy()
    directions[:, 1] *= t * t * (3.0 - 2.0 * t)
    return directions / np.einsum("ij,ij->i", directions, normals)[:, None]


def extrude(
    points: Array,
    directions: Array,
    triangles: NDArray[np.int64],
    under_nail: NDArray[np.bool_],
    layers: Layering,
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Extrude the skin inwards.

    Parameters
    ----------
    points, directions
        (n, 3) points of the outer skin in mm, and outward directions.
    triangles, under_nail
        (m, 3) corners, oriented outwards; (m,) whether a triangle is under the nail.
    layers
        The rows.

    Returns
    -------
    nodes, tets, tissue
        (n (r + 1), 3), node i of depth k at n k + i; (3 m r, 4); (3 m r,) tags.
    """
    count, rows = len(points), len(layers.tissue)
    nodes = np.vstack([points - depth * directions for depth in layers.depths])
    # Sorted corners give the two prisms at a common side the same diagonal.
    order = np.argsort(triangles, axis=1)
    i, j, k = np.take_along_axis(triangles, order, axis=1).T
    prism = np.stack(
        [
            np.column_stack([i, j, k, k + count]),
            np.column_stack([j, i, j + count, k + count]),
            np.column_stack([i, i + count, j + count, k + count]),
        ],
        axis=1,
    )
    odd = (order[:, 0] > order[:, 1]) ^ (order[:, 1] > order[:, 2]) ^ (order[:, 0] > order[:, 2])
    # (i, j, k) is oriented outwards and the fourth corner is inside, so even ones are inverted.
    prism[~odd] = prism[~odd][..., [1, 0, 2, 3]]
    tets = np.concatenate([prism.reshape(-1, 4) + row * count for row in range(rows)])
    tissue = np.empty((rows, len(triangles), 3), dtype=np.int64)
    for row in range(rows):
        nail = under_nail & (row < layers.nail_rows)
        tissue[row] = np.where(nail, TISSUES["nail"], layers.tissue[row])[:, None]
    return nodes, tets, tissue.reshape(-1)
