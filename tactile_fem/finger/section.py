"""Meshes a plane section of the parametric finger with triangles.

The contour of the skin is divided, and each of its points carries a column of nodes through the
layers; gmsh fills fat and bone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.anatomy import Anatomy
from tactile_fem.finger.layers import Layering, extrusion_directions
from tactile_fem.finger.plane import Array, Plane
from tactile_fem.finger.session import fill_plane
from tactile_fem.finger.shape import Capsule
from tactile_fem.finger.simplex import Indices, volumes

_BONE_SHARE = 0.5  # edges on the bone over those of a solid finger
_SAMPLE_COUNT = 20_001  # of a contour, to measure its length


@dataclass(frozen=True)
class Contour:
    """A curve in the plane of a section, from the palmar side of the cut around the tip."""

    points: Array  # (n, 3)
    normals: Array  # (n, 3) outward unit vectors
    length: Array  # (n,) of the curve from the contact point on, mm
    closed: bool  # across the finger, where it ends where it begins


def section_cells(anatomy: Anatomy) -> tuple[Array, tuple[Indices, Indices], Indices, Indices]:
    """Return nodes (n, 3); triangles (m, 3) of the layers, their tissues (m,); of fat; of bone."""
    finger, sizes, capsule = anatomy.finger, anatomy.sizes, anatomy.skin.capsule
    plane = finger.section_plane
    rows = anatomy.rows.divided(sizes.pad)
    skin = _contour(capsule, plane)
    nail = anatomy.nail.ends(plane.axes[0])
    dorsal = np.flatnonzero(_is_dorsal(skin.points, capsule))
    along = plane.within(skin.points[dorsal])[:, 0]
    at_nail = [skin.length[dorsal[np.argmin(np.abs(along - end))]] for end in nail]
    skin = _divided(skin, _skin_sizes(skin, anatomy), [0.0, *at_nail])
    nodes = _columns(skin, rows, anatomy)
    following = np.roll(skin.points, -1, axis=0)
    middle = ((skin.points + following) / 2)[: None if skin.closed else -1]
    along = plane.within(middle)[:, 0]
    under_nail = (along > nail[0]) & (along < nail[1]) & _is_dorsal(middle, capsule)
    cells, tissue = _triangles_of_layers(skin, rows, under_nail)
    assert isinstance(anatomy.bone, Capsule)  # sections have no scans
    bone, size = _contour(anatomy.bone, plane), sizes.on_bone(finger)
    at = bone.points - [0, 0, anatomy.bone.axis_z]
    bone = _divided(bone, [_BONE_SHARE * size(*point) for point in at], [0.0])
    nodes, fat, marrow = _fill(nodes, len(skin.points), bone, sizes.far)
    flat = plane.within(nodes)
    cells, fat, marrow = (_counterclockwise(part, flat) for part in (cells, fat, marrow))
    return nodes, (cells, tissue), fat, marrow


def _contour(body: Capsule, plane: Plane) -> Contour:
    """Return the contour of a body, densely sampled; its length counts from below the contact."""
    closed = plane.axes[0] == 0
    if closed:
        turn = np.linspace(-np.pi, np.pi, _SAMPLE_COUNT) - np.pi / 2
        reference = np.column_stack([np.cos(turn), np.zeros_like(turn), np.sin(turn)])
    else:
        half = np.linspace(0.0, 1.0, _SAMPLE_COUNT // 2 + 1)
        shaft = body.shoulder_y - body.cut_y
        y = body.cut_y + half * (shaft + np.pi / 2 * body.tip_length)
        beyond = np.clip((y - body.shoulder_y) / body.tip_length, 0.0, np.pi / 2)
        y = np.where(y > body.shoulder_y, body.shoulder_y + body.tip_length * np.sin(beyond), y)
        y = np.append(y[:-1], [body.tip_y, *y[-2::-1]])
        below = np.arange(len(y)) < len(half)
        reference = np.column_stack([0 * y, y, np.where(below, -1.0, 1.0)])
    points, normals = body.place(reference)
    points[:, plane.across] = normals[:, plane.across] = 0.0
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    aside = np.where(_is_dorsal(points, body), np.inf, np.abs(plane.within(points)[:, 0]))
    return Contour(points, normals, length - length[np.argmin(aside)], closed)


def _is_dorsal(points: Array, body: Capsule) -> NDArray[np.bool_]:
    """Return which points (n, 3) lie above the axis of a body."""
    return points[:, 2] > body.axis_z + body.rise(points[:, 1])[0]


def _skin_sizes(skin: Contour, anatomy: Anatomy) -> list[float]:
    """Return the edge length at each point of the contour of the skin."""
    finger, capsule = anatomy.finger, anatomy.skin.capsule
    at = skin.points - [0.0, 0.0, capsule.axis_z]
    at[:, 2] -= capsule.rise(skin.points[:, 1])[0]
    size = anatomy.sizes.on_skin(capsule)
    found = np.array([size(*point) for point in at])
    if finger.is_ridged:
        found[np.abs(skin.length) <= finger.ridged_half_length_mm] = anatomy.sizes.pad
    return found.tolist()


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


def _columns(skin: Contour, rows: Layering, anatomy: Anatomy) -> Array:
    """Return the nodes of the layers, node i of row k at n k + i; ridges shift their limits."""
    directions = extrusion_directions(skin.points, skin.normals, anatomy.skin.capsule.cut_y)
    s, ridges, finger = skin.length, anatomy.ridges, anatomy.finger
    dermis = finger.stratum_corneum_mm + finger.epidermis_mm
    limits = np.array([0.0, finger.stratum_corneum_mm, dermis, finger.skin_thickness_mm])
    shifts = [ridges.skin(s), ridges.skin(s), ridges.interface(s), 0 * s, 0 * s]
    at = np.searchsorted(limits, rows.depths, side="right") - 1
    limits = np.append(limits, limits[-1] + 1)
    nodes = []
    for depth, k in zip(rows.depths, at, strict=True):
        share = (depth - limits[k]) / (limits[k + 1] - limits[k])
        own = depth + (1 - share) * shifts[k] + share * shifts[k + 1]
        nodes.append(skin.points - own[:, None] * directions)
    return np.concatenate(nodes)


def _triangles_of_layers(
    skin: Contour, rows: Layering, under_nail: NDArray[np.bool_]
) -> tuple[Indices, Indices]:
    """Return the triangles (m, 3) of the columns and their tissues (m,)."""
    count = len(skin.points)
    i = np.arange(len(under_nail))
    j = (i + 1) % count
    quads = np.column_stack([i, j, j + count, i + count])
    # Diagonals lean to both sides alike about the contact point.
    leans = (skin.length[i] < 0)[:, None]
    one = np.where(leans, quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    other = np.where(leans, quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    return rows.stacked(np.concatenate([one, other]), np.tile(under_nail, 2), count)


def _fill(nodes: Array, count: int, bone: Contour, size: float) -> tuple[Array, Indices, Indices]:
    """Fill the inside of the layers; return the nodes and the triangles of fat and bone."""
    inner = np.arange(len(nodes) - count, len(nodes))
    own = len(nodes) + np.arange(len(bone.points))
    nodes = np.vstack([nodes, bone.points])
    around_fat, around_bone = [inner, own], own
    if not bone.closed:
        nodes, dorsal = _between(nodes, inner[-1], own[-1], size)
        nodes, palmar = _between(nodes, own[0], inner[0], size)
        nodes, inside = _between(nodes, own[-1], own[0], size)
        around_fat = [np.concatenate([inner, dorsal, own[::-1], palmar])]
        around_bone = np.concatenate([own, inside])
    nodes, fat = fill_plane(nodes, around_fat, size)
    nodes, marrow = fill_plane(nodes, [around_bone], size)
    return nodes, fat, marrow


def _between(nodes: Array, start: int, end: int, size: float) -> tuple[Array, Indices]:
    """Add nodes on the straight line between two; return their numbers as well."""
    a, b = nodes[start], nodes[end]
    parts = max(1, math.ceil(np.linalg.norm(b - a) / size))
    new = a + np.linspace(0, 1, parts + 1)[1:-1, None] * (b - a)
    return np.vstack([nodes, new]), len(nodes) + np.arange(len(new))


def _counterclockwise(cells: Indices, nodes: Array) -> Indices:
    """Return triangles whose corners run counterclockwise in the plane."""
    wrong = volumes(nodes, cells) < 0
    return np.where(wrong[:, None], cells[:, [0, 2, 1]], cells)
