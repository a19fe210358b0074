"""Meshes the parametric finger: the skin is extruded inwards, the rest filled by gmsh."""

from __future__ import annotations

import logging
from types import ModuleType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger.layers import extrude, extrusion_directions, layering
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, facets_of, quadratic
from tactile_fem.finger.report import check_mesh
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.shape import Array, bone_shape, skin_shape
from tactile_fem.finger.skin import bone_size, nail_outline, pad_size, sizes_of, triangulate
from tactile_fem.study import Finger

logger = logging.getLogger(__name__)

Triangles = NDArray[np.int64]


def build_finger(finger: Finger) -> FingerMesh:
    """Mesh the parametric finger; the same parameters give the same mesh.

    Raises
    ------
    MeshError
        If the lengths do not make a finger, or gmsh is missing or fails.
    """
    sizes = sizes_of(finger)
    rows = layering(finger, sizes.epidermis_rows)
    skin, bone, nail = skin_shape(finger), bone_shape(finger), nail_outline(finger)
    lift, _ = skin.rise(skin.cut_y)
    if lift < 2.5:
        logger.warning("the skin rises only %.1f mm from the contact point to the cut", lift)

    points, normals, outer, under_nail = triangulate(skin, pad_size(sizes, skin), nail)
    directions = extrusion_directions(points, normals, skin.cut_y)
    nodes, tets, tissue = extrude(points, directions, outer, under_nail, rows)
    inner = outer + len(nodes) - len(points)

    bone_points, _, bone_triangles, _ = triangulate(bone, bone_size(sizes, finger))
    bone_triangles = bone_triangles + len(nodes)
    nodes = np.vstack([nodes, bone_points])

    inner_loop, bone_loop = _rim(inner), _rim(bone_triangles)
    nodes, annulus = _fill_plane(nodes, [inner_loop, bone_loop], sizes.far)
    nodes, disc = _fill_plane(nodes, [bone_loop], sizes.far)
    nodes, fat = _fill_volume(nodes, [inner, bone_triangles, annulus], improve=True)
    nodes, marrow = _fill_volume(nodes, [bone_triangles, disc])

    tets = np.concatenate([tets, fat, marrow])
    tissue = np.concatenate(
        [
            tissue,
            np.full(len(fat), TISSUES["subcutaneous"]),
            np.full(len(marrow), TISSUES["bone"]),
        ]
    )
    triangles, surface = tag_surfaces(nodes, tets, tissue, skin.cut_y)
    nodes, tets, triangles = quadratic(nodes, tets, triangles)
    mesh = FingerMesh(nodes, tets, tissue, triangles, surface)
    check_mesh(mesh)
    logger.info("finger of %d tetrahedra and %d nodes", len(tets), len(nodes))
    return mesh


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


def _fill_plane(
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
    nodes: Array, surfaces: list[Triangles], improve: bool = False
) -> tuple[Array, NDArray[np.int64]]:
    """Fill a closed surface with tetrahedra; `improve` removes slivers and adds a few cells."""
    with gmsh_model() as gmsh:
        mesh = gmsh.model.mesh
        known = np.unique(np.concatenate(surfaces))
        faces = [gmsh.model.addDiscreteEntity(2) for _ in surfaces]
        mesh.addNodes(2, faces[0], known + 1, nodes[known].ravel())
        for face, triangles in zip(faces, surfaces, strict=True):
            mesh.addElementsByType(face, 2, [], (triangles + 1).ravel())
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(faces)])
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
