"""Meshes a plane section of the parametric finger with triangles.

The skin's contour is divided, and each of its points carries a column of nodes through the layers;
gmsh fills fat and bone.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger.anatomy import Anatomy
from tactile_fem.finger.build import (
    Layering,
    extrusion_directions,
    fill_plane,
    layering,
    put_together,
)
from tactile_fem.finger.mesh_data import TISSUES, FingerMesh, Indices
from tactile_fem.finger.plane import PLANES, Plane
from tactile_fem.finger.report import edges_per_ridge, volumes
from tactile_fem.finger.ridges import Ridges
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import Array, Capsule
from tactile_fem.finger.skin import NailOutline, Size, Sizes, bone_size, pad_size, sizes_of

logger = logging.getLogger(__name__)

# A section's edges as a share of the solid finger's, under the contact patch and on the bone.
_FINER, _BONE, _FAR = 0.25, 0.5, 0.4
# Edges grow so much per mm from the patch: skin is dragged far along the section.
_SLOW = 0.05
_PER_RIDGE, _LEAST_PER_RIDGE = 8, 4
# Points of a contour from which it is measured.
_DENSE = 20_001
# Rows are at most so many times as high as the edges under the patch are long; in the dermis they
# grow by this share of the depth below its upper limit.
_TALLEST, _GROWTH = 1.3, 0.35


@dataclass(frozen=True)
class Contour:
    """A curve in the plane of a section, from the palmar side of the cut around the tip.

    Attributes
    ----------
    points, normals
        (n, 3) in mm, (n, 3) outward unit vectors.
    length
        Of the curve up to each point, from the contact point on, (n,) mm.
    closed
        Whether it ends where it begins.
    """

    points: Array
    normals: Array
    length: Array
    closed: bool


def section_sizes(finger: Finger) -> Sizes:
    """Return the edge lengths of a section.

    Raises
    ------
    MeshError
        They are too long for the ridges.
    """
    sizes, ridges = sizes_of(finger), Ridges.of(finger)
    pad = finger.pad_size_mm or _FINER * sizes.pad
    if ridges.any:
        pad = finger.pad_size_mm or min(pad, ridges.pitch / _PER_RIDGE)
        if pad > ridges.pitch / _LEAST_PER_RIDGE:
            raise MeshError(
                f"finger.ridge_pitch_mm = {ridges.pitch:g} must be at least {_LEAST_PER_RIDGE} "
                f"times the edge under the contact patch, pad_size_mm = {pad:g}"
            )
    far = finger.far_size_mm or max(_FAR * sizes.far, pad)
    return replace(sizes, pad=pad, far=far, growth=_SLOW, curve=0.0)


def build_section(finger: Finger) -> FingerMesh:
    """Mesh a section of the parametric finger; the same parameters give the same mesh.

    Raises
    ------
    MeshError
        If the lengths do not make a finger, or gmsh is missing or fails.
    """
    sizes, ridges, anatomy = section_sizes(finger), Ridges.of(finger), Anatomy.of(finger)
    capsule, plane = anatomy.skin.capsule, Plane.of(finger)
    rows = _finer(layering(finger, 1), sizes.pad)
    skin = _contour(capsule, plane)
    near = pad_size(sizes, capsule)
    sizes_there = _on_skin(near, sizes.pad, capsule, ridges, skin)
    skin = _divided(skin, sizes_there, _ends(anatomy.nail, skin, capsule))
    directions = skin.normals
    if not skin.closed:
        directions = extrusion_directions(skin.points, skin.normals, capsule.cut_y)
    nodes = _columns(skin, directions, rows, ridges, finger)
    cells, tissue = _layers(skin, rows, _under(anatomy.nail, skin, capsule))
    bone = _contour(anatomy.bone.capsule, plane)
    by_size = bone_size(sizes, finger)
    sizes_there = [_BONE * by_size(*p) for p in bone.points - [0, 0, anatomy.bone.axis_z]]
    bone = _divided(bone, sizes_there, [0.0])
    nodes, fat, marrow = _fill(nodes, len(skin.points), bone, sizes.far)
    flat = plane.within(nodes)
    cells, fat, marrow = (_turned(part, flat) for part in (cells, fat, marrow))
    mesh = put_together(nodes, (cells, tissue), fat, marrow, capsule.cut_y)
    if count := edges_per_ridge(mesh, finger):
        logger.info("%.1f edges to a ridge of %g mm", count, ridges.pitch)
    return mesh


# --- contours ----------------------------------------------------------------------------------


def _contour(body: Capsule, plane: Plane) -> Contour:
    """Return the contour of a body, densely sampled; its length counts from below the contact."""
    zero = np.zeros(_DENSE)
    if plane.axes == PLANES["transverse"]:
        turn = np.linspace(-np.pi, np.pi, _DENSE) - np.pi / 2
        reference, closed = np.column_stack([np.cos(turn), zero, np.sin(turn)]), True
    else:
        half = np.linspace(0.0, 1.0, _DENSE // 2 + 1)
        shaft = body.shoulder_y - body.cut_y
        y = body.cut_y + half * (shaft + np.pi / 2 * body.tip_length)
        beyond = np.clip((y - body.shoulder_y) / body.tip_length, 0.0, np.pi / 2)
        y = np.where(y > body.shoulder_y, body.shoulder_y + body.tip_length * np.sin(beyond), y)
        y = np.append(y[:-1], [body.tip_y, *y[-2::-1]])
        below = np.arange(len(y)) < len(half)
        reference, closed = np.column_stack([0 * y, y, np.where(below, -1.0, 1.0)]), False
    points, normals = body.place(reference)
    points[:, plane.across] = normals[:, plane.across] = 0.0
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    aside = np.where(_is_dorsal(points, body), np.inf, np.abs(points[:, plane.axes[0]]))
    return Contour(points, normals, length - length[np.argmin(aside)], closed)


def _is_dorsal(points: Array, body: Capsule) -> NDArray[np.bool_]:
    """Return which points (n, 3) lie above the body's axis."""
    return points[:, 2] > body.axis_z + body.rise(points[:, 1])[0]


def _on_skin(
    size: Size, pad: float, capsule: Capsule, ridges: Ridges, skin: Contour
) -> list[float]:
    """Return the edge length at each point of the skin's contour."""
    at = skin.points - [0.0, 0.0, capsule.axis_z]
    at[:, 2] -= capsule.rise(skin.points[:, 1])[0]
    found = np.array([size(*point) for point in at])
    if ridges.any:
        found[np.abs(skin.length) <= ridges.half_length] = pad
    return found.tolist()


def _ends(nail: NailOutline, skin: Contour, capsule: Capsule) -> list[float]:
    """Return the lengths at which edges must end: at the contact point, at the nail's ends."""
    dorsal = np.flatnonzero(_is_dorsal(skin.points, capsule))
    if skin.closed:
        places, goals = skin.points[:, 0], [-nail.half_width, nail.half_width]
    else:
        places, goals = skin.points[:, 1], [nail.start_y, nail.end_y]
    at = [dorsal[np.argmin(np.abs(places[dorsal] - goal))] for goal in goals]
    return [0.0, *skin.length[at].tolist()]


def _divided(contour: Contour, size: list[float], ends: list[float]) -> Contour:
    """Divide a contour by edges of a size (n,), so that edges end at some lengths."""
    length = contour.length
    density = 1 / np.asarray(size)
    count = np.append(0.0, np.cumsum(np.diff(length) * (density[1:] + density[:-1]) / 2))
    breaks = np.array(sorted([length[0], *ends, length[-1]]))
    chosen = []
    for low, high in pairwise(breaks):
        first, last = np.interp([low, high], length, count)
        edges = max(1, math.ceil(last - first))
        chosen.append(np.interp(np.linspace(first, last, edges + 1)[:-1], count, length))
    at = np.concatenate(chosen if contour.closed else [*chosen, breaks[-1:]])
    points, normals = (
        np.column_stack([np.interp(at, length, column) for column in values.T])
        for values in (contour.points, contour.normals)
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Contour(points, normals, at, contour.closed)


# --- layers ------------------------------------------------------------------------------------


def _finer(rows: Layering, pad: float) -> Layering:
    """Divide rows that are too high for the edges under the patch."""
    depths, tissue, nail_rows = [0.0], [], 0
    dermis = rows.depths[np.argmax(rows.tissue == TISSUES["dermis"])]
    for k, (top, bottom) in enumerate(pairwise(rows.depths)):
        growth = _GROWTH if top >= dermis else 0.0
        # Rows that grow with the depth are of one height on the scale of its logarithm.
        grown = (math.log1p(growth * (bottom - top) / (_TALLEST * pad)) / growth) if growth else 0.0
        parts = math.ceil(grown if growth else (bottom - top) / (_TALLEST * pad))
        share = np.linspace(0, 1, parts + 1)[1:]
        if growth:
            share = np.expm1(share * growth * grown) / np.expm1(growth * grown)
        depths += (top + share * (bottom - top)).tolist()
        tissue += [rows.tissue[k]] * parts
        nail_rows += parts * (k < rows.nail_rows)
    return Layering(np.array(depths), np.array(tissue), nail_rows)


def _columns(
    skin: Contour, directions: Array, rows: Layering, ridges: Ridges, finger: Finger
) -> Array:
    """Return the nodes of the layers, node i of row k at n k + i; ridges shift their limits."""
    corneum = finger.stratum_corneum_mm
    dermis = corneum + finger.epidermis_mm
    limits = np.array([0.0, corneum, dermis, dermis + finger.dermis_mm])
    s, at = skin.length, np.searchsorted(limits, rows.depths, side="right") - 1
    shifts = [ridges.skin(s), ridges.skin(s), ridges.interface(s), 0 * s, 0 * s]
    limits = np.append(limits, limits[-1] + 1)
    nodes = []
    for depth, k in zip(rows.depths, at, strict=True):
        share = (depth - limits[k]) / (limits[k + 1] - limits[k])
        own = depth + (1 - share) * shifts[k] + share * shifts[k + 1]
        nodes.append(skin.points - own[:, None] * directions)
    return np.concatenate(nodes)


def _under(nail: NailOutline, skin: Contour, capsule: Capsule) -> NDArray[np.bool_]:
    """Return which edges of the skin lie under the nail, (edges,)."""
    following = np.roll(skin.points, -1, axis=0)
    middle = ((skin.points + following) / 2)[: None if skin.closed else -1]
    if skin.closed:
        covered = np.abs(middle[:, 0]) < nail.half_width
    else:
        covered = (middle[:, 1] > nail.start_y) & (middle[:, 1] < nail.end_y)
    return covered & _is_dorsal(middle, capsule)


def _layers(
    skin: Contour, rows: Layering, under_nail: NDArray[np.bool_]
) -> tuple[Indices, Indices]:
    """Return the triangles (m, 3) of the columns and their tissues (m,)."""
    count = len(skin.points)
    i = np.arange(len(under_nail))
    j = (i + 1) % count
    # Diagonals lean to both sides alike about the contact point.
    leans = (skin.length[i] < 0)[:, None]
    one = np.where(leans, *(np.column_stack(c) for c in ([i, j, j + count], [i, j, i + count])))
    other = np.where(
        leans,
        *(np.column_stack(c) for c in ([i, j + count, i + count], [j, j + count, i + count])),
    )
    pair = np.concatenate([one, other])
    cells, tissue = [], []
    for row, own in enumerate(rows.tissue):
        nail = under_nail & (row < rows.nail_rows)
        cells.append(pair + row * count)
        tissue.append(np.tile(np.where(nail, TISSUES["nail"], own), 2))
    return np.concatenate(cells), np.concatenate(tissue)


# --- fat and bone ------------------------------------------------------------------------------


def _fill(nodes: Array, count: int, bone: Contour, size: float) -> tuple[Array, Indices, Indices]:
    """Fill the inside of the layers; return the nodes and the triangles of fat and bone."""
    inner = np.arange(len(nodes) - count, len(nodes))
    own = len(nodes) + np.arange(len(bone.points))
    nodes = np.vstack([nodes, bone.points])
    if bone.closed:
        nodes, fat = fill_plane(nodes, [inner, own], size)
        nodes, marrow = fill_plane(nodes, [own], size)
        return nodes, fat, marrow
    nodes, dorsal = _between(nodes, inner[-1], own[-1], size)
    nodes, palmar = _between(nodes, own[0], inner[0], size)
    nodes, inside = _between(nodes, own[-1], own[0], size)
    nodes, fat = fill_plane(nodes, [np.concatenate([inner, dorsal, own[::-1], palmar])], size)
    nodes, marrow = fill_plane(nodes, [np.concatenate([own, inside])], size)
    return nodes, fat, marrow


def _between(nodes: Array, start: int, end: int, size: float) -> tuple[Array, Indices]:
    """Add nodes on the straight line between two; return their numbers as well."""
    a, b = nodes[start], nodes[end]
    parts = max(1, math.ceil(np.linalg.norm(b - a) / size))
    new = a + np.linspace(0, 1, parts + 1)[1:-1, None] * (b - a)
    return np.vstack([nodes, new]), len(nodes) + np.arange(len(new))


def _turned(cells: Indices, nodes: Array) -> Indices:
    """Return triangles whose corners run counterclockwise in the plane."""
    wrong = volumes(nodes, cells) < 0
    return np.where(wrong[:, None], cells[:, [0, 2, 1]], cells)
