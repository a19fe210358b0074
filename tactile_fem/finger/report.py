"""Measures a mesh: volumes, quality, thickness of the layers; and checks that it can be used."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import (
    SOLID,
    SURFACES,
    TISSUES,
    FingerMesh,
    facets_of,
    lowest_facet,
)
from tactile_fem.finger.ridges import Ridges
from tactile_fem.finger.settings import Finger

LAYERS = ("stratum_corneum", "epidermis", "dermis")
_SMALLEST_MM, _LARGEST_MM = 1.0, 1000.0
_IN_PLANE_MM = 1e-6
CONTACT_MM = 3.0  # half the width of the patch in which facets are measured
PAD_MM = (6.0, 9.0)  # half width and half length in which the layers are measured


def volumes(nodes: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the signed volumes (m,) in mm^3 of tetrahedra, or the areas in mm^2 of triangles.

    The nodes are (n, 3) or, in the plane of a section, (n, 2).
    """
    dim = nodes.shape[1]
    edges = nodes[cells[:, 1 : dim + 1]] - nodes[cells[:, :1]]
    return np.linalg.det(edges) / math.factorial(dim)


def gammas(nodes: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return gmsh's quality gamma (m,): inradius over circumradius, 1 if regular.

    Nodes are (n, 3), or (n, 2) for triangles.
    """
    if nodes.shape[1] == 2:
        corners = nodes[cells[:, :3]]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        area = np.abs(volumes(nodes, cells))
        return 16 * area**2 / (sides.sum(axis=1) * sides.prod(axis=1))
    p, q, r = (nodes[cells[:, i]] - nodes[cells[:, 0]] for i in (1, 2, 3))
    faces = np.array([np.cross(q, r), np.cross(r, p), np.cross(p, q)])
    faces_and_base = np.array([*faces, faces.sum(axis=0)])
    area = np.linalg.norm(faces_and_base, axis=2).sum(axis=0) / 2
    squares = (np.array([p, q, r]) ** 2).sum(axis=2, keepdims=True)
    volume = np.abs(volumes(nodes, cells))
    # The inradius is 3 V / A, the circumradius |sum of squares times faces| / (12 V).
    circumradius_12V = np.linalg.norm((squares * faces).sum(axis=0), axis=1)
    return 3 * (3 * volume / area) * (12 * volume / circumradius_12V)


def _jacobians(mesh: FingerMesh) -> NDArray[np.float64]:
    """Return the determinants (m, nodes) of the quadratic map at the nodes of each cell."""
    shape = mesh.simplex
    one, other = shape.edges.T
    corners = np.eye(shape.corners)
    barycentric = np.vstack([corners, 0.5 * (corners[one] + corners[other])])
    result = np.empty(mesh.cells.shape)
    x = mesh.plane.within(mesh.nodes)[mesh.cells]
    for point, weights in enumerate(barycentric):
        result[:, point] = np.linalg.det(np.einsum("mni,nj->mij", x, shape.gradients(weights)))
    return result


def check_mesh(mesh: FingerMesh) -> None:
    """Check that a mesh can be used for computations.

    Raises
    ------
    MeshError
        Cells are inverted, a facet belongs to more than two of them, a tissue or a surface is
        missing, coordinates are not finite or not in mm, a section lies in no plane across or along
        the finger, or there is no skin or bone above the contact point.
    """
    if mesh.missing:
        raise MeshError(f"the mesh lacks the part {', '.join(mesh.missing)}")
    if not np.all(np.isfinite(mesh.nodes)):
        raise MeshError("the mesh has nodes whose coordinates are no finite numbers")
    length = float(np.ptp(mesh.nodes, axis=0).max())
    if not _SMALLEST_MM < length < _LARGEST_MM:
        raise MeshError(f"the mesh is {length:g} mm long, which is no finger: is it in mm?")
    plane, shape = mesh.plane, mesh.simplex
    if np.abs(plane.points(plane.within(mesh.nodes)) - mesh.nodes).max() > _IN_PLANE_MM:
        raise MeshError("the mesh of triangles lies in no plane X = 0 or Y = 0")
    bad = np.flatnonzero(_jacobians(mesh).min(axis=1) <= 0.0)
    if len(bad):
        where = mesh.nodes[mesh.cells[bad[0], : shape.corners]].mean(axis=0)
        raise MeshError(
            f"{len(bad)} {shape.plural} have a non-positive Jacobian, the first at "
            f"({where[0]:.2f}, {where[1]:.2f}, {where[2]:.2f}) mm"
        )
    try:
        facets_of(mesh.cells)
    except ValueError as error:
        raise MeshError(f"the mesh is not conforming: {error}") from error
    pad_thickness_mm(mesh)


def pad_thickness_mm(mesh: FingerMesh) -> float:
    """Return the height in mm from skin to bone above the contact point, X = Y = 0.

    Raises
    ------
    MeshError
        There is no skin or no bone.
    """
    heights = []
    for name in ("skin", "bone_surface"):
        facets = mesh.corners_of(name)
        found = lowest_facet(0.0, 0.0, facets)
        if found is None:
            raise MeshError(f"the mesh has no {name} above the contact point, X = Y = 0")
        facet, weights = found
        heights.append(float(weights @ facets[facet, :, 2]))
    return heights[1] - heights[0]


def facet_size_mm(mesh: FingerMesh) -> float:
    """Return the mean length in mm of the edges of the skin's facets under the contact patch."""
    facets = mesh.corners_of("skin")
    middle = facets.mean(axis=1)
    near = np.all(np.abs(middle[:, :2]) < CONTACT_MM, axis=1) & (middle[:, 2] < CONTACT_MM)
    if not near.any():
        near[np.argmin(np.linalg.norm(middle, axis=1))] = True
    edges = facets[near] - np.roll(facets[near], 1, axis=1)
    return float(np.linalg.norm(edges, axis=2).mean())


def edges_per_ridge(mesh: FingerMesh, finger: Finger) -> float | None:
    """Return how many edges of the skin under the patch a fingerprint's ridge has; None: smooth."""
    return finger.ridge_pitch_mm / facet_size_mm(mesh) if Ridges.of(finger).any else None


def measured_layers_mm(mesh: FingerMesh) -> dict[str, float]:
    """Return the mean thickness in mm of each layer of the pad, as `layer_thickness` measures."""
    return {name: float(found.mean()) for name, found in layer_thickness(mesh).items()}


def layer_thickness(mesh: FingerMesh) -> dict[str, NDArray[np.float64]]:
    """Measure the layers of the pad.

    Returns
    -------
    thickness
        mm per layer, the stratum corneum first: distances from the facet centres of the layer's
        outer boundary on the pad to the nearest point of its inner boundary. Missing layers are
        left out.
    """
    dim = mesh.simplex.dim
    facets, first, second = facets_of(mesh.cells)
    inner = second >= 0
    one, other = mesh.tissue[first[inner]], mesh.tissue[second[inner]]
    low, high = np.minimum(one, other), np.maximum(one, other)
    limits = [mesh.facets[mesh.surface == SURFACES["skin"], :dim]]
    for depth in range(1, len(LAYERS) + 1):
        limits.append(facets[inner][(low == depth) & (high == depth + 1)])
    thickness = {}
    for name, above, below in zip(LAYERS, limits[:-1], limits[1:], strict=True):
        middle = mesh.nodes[above].mean(axis=1)
        in_pad = np.all(np.abs(middle[:, :2]) < PAD_MM, axis=1) & (middle[:, 2] < PAD_MM[0])
        if in_pad.any() and len(below):
            thickness[name] = _distances(middle[in_pad], mesh.nodes[below])
    return thickness


def _distances(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances from points (n, 3) to the nearest of the triangles or lines (m, d, 3)."""
    if corners.shape[1] == 2:
        return _distances_to_lines(points, corners)
    count = min(12, len(corners))
    _, near = cKDTree(corners.mean(axis=1)).query(points, k=count)
    a, b, c = np.moveaxis(corners[near.reshape(len(points), count)], 2, 0)
    p = points[:, None]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    height = np.abs(np.sum((p - a) * normal, axis=-1))
    beside = np.zeros_like(height, dtype=bool)
    rim = np.full_like(height, np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        beside |= np.sum(np.cross(edge, p - start) * normal, axis=-1) < 0.0
        t = np.sum((p - start) * edge, axis=-1) / np.sum(edge**2, axis=-1)
        foot = start + np.clip(t, 0.0, 1.0)[..., None] * edge
        rim = np.minimum(rim, np.linalg.norm(p - foot, axis=-1))
    return np.where(beside, rim, height).min(axis=1)


def _distances_to_lines(
    points: NDArray[np.float64], lines: NDArray[np.float64]
) -> NDArray[np.float64]:
    start, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    p = points[:, None] - start
    t = np.clip(np.sum(p * along, axis=-1) / np.sum(along**2, axis=-1), 0.0, 1.0)
    return np.linalg.norm(p - t[..., None] * along, axis=-1).min(axis=1)


def describe(mesh: FingerMesh, finger: Finger) -> str:
    """Return a table to print: tissues, surfaces and layers, with the study's layers if any."""
    shape, nodes = mesh.simplex, mesh.plane.within(mesh.nodes)
    volume, gamma = volumes(nodes, mesh.cells), gammas(nodes, mesh.cells)
    count = len(nodes)
    size, unit = ("volume", "mm^3") if shape is SOLID else ("area", "mm^2")
    lines = [
        f"{len(mesh.cells)} {shape.plural}, {count} nodes, {shape.dim * count} displacements, "
        f"{size} {volume.sum():.1f} {unit}",
        f"{'tissue':<16}{'cells':>8}{unit:>10}{'min gamma':>11}{'mean':>7}",
    ]
    for name, tag in TISSUES.items():
        part = mesh.tissue == tag
        if part.any():
            quality = f"{gamma[part].min():>11.3f}{gamma[part].mean():>7.3f}"
            lines.append(f"{name:<16}{part.sum():>8}{volume[part].sum():>10.1f}{quality}")
    lines.append(f"{'surface':<16}{'facets':>8}")
    lines += [f"{name:<16}{np.sum(mesh.surface == tag):>8}" for name, tag in SURFACES.items()]
    parametric = finger.mesh_file is None
    heading = [*(["study"] if parametric else []), "min", "mean", "max"]
    lines.append(f"{'layer of the pad':<16}{''.join(f'{word:>8}' for word in heading)} mm")
    for name, found in layer_thickness(mesh).items():
        row = [getattr(finger, f"{name}_mm")] if parametric else []
        row += [found.min(), found.mean(), found.max()]
        lines.append(f"{name:<16}{''.join(f'{value:>8.3f}' for value in row)}")
    lines.append(f"skin to bone over the contact point {pad_thickness_mm(mesh):.3f} mm")
    if count := edges_per_ridge(mesh, finger):
        lines.append(f"{count:.1f} edges to a ridge of {finger.ridge_pitch_mm:g} mm")
    return "\n".join([*lines, f"sha256 {mesh.hash}"])
