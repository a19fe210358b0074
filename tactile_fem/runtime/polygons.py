"""Reads OBJ and PLY files of polygons, and divides polygons into triangles.

trimesh divides each polygon like a fan, which is wrong if it is not convex, counts negative
indices of OBJ from the end of the file, and reads no binary PLY whose faces differ in length.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from tactile_fem.runtime.numbers import Numbers

Indices = NDArray[np.int64]

# Sines of the corners of a convex polygon, at least.
_CONVEX = 1e-3
# The triangles of a polygon have its area up to this share, and to this one of its size's square.
_AREA, _SLIVER = 1e-6, 1e-9
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}


@dataclass(frozen=True)
class Polygons:
    """A surface of polygons.

    Attributes
    ----------
    points
        (n, 3).
    corners
        Of all faces after each other, flat.
    counts
        Corners of each face.
    """

    points: NDArray[np.float64]
    corners: Indices
    counts: Indices

    def triangles(self) -> Indices:
        """Divide the faces into triangles (m, 3); faces of less than three corners are left out.

        Raises
        ------
        ValueError
            A face has corners that do not exist, or its sides cross.
        """
        if len(self.corners) and not 0 <= self.corners.min() <= self.corners.max() < len(
            self.points
        ):
            raise ValueError("faces have corners that it does not contain")
        if not np.all(np.isfinite(self.points[self.corners])):
            raise ValueError("coordinates are no finite numbers")
        first = np.cumsum(self.counts) - self.counts
        found = [np.zeros((0, 3), np.int64)]
        for count in np.unique(self.counts[self.counts > 2]).tolist():
            faces = self.corners[first[self.counts == count][:, None] + np.arange(count)]
            if count == 3:
                found.append(faces)
            else:
                found.append(_divided(self.points, faces))
        return np.concatenate(found)


def _divided(points: NDArray[np.float64], faces: Indices) -> Indices:
    """Return triangles (m, 3) of faces (k, n) with four or more corners."""
    corners = points[faces]
    if faces.shape[1] == 4:
        return _halves(corners, faces)
    following = np.roll(corners, -1, axis=1) - corners
    turn = np.cross(np.roll(following, 1, axis=1), following)
    normal = _area(corners)
    length = np.linalg.norm(following, axis=2)
    sine = np.einsum("kni,ki->kn", turn, normal)
    least = _CONVEX * np.roll(length, 1, axis=1) * length * np.linalg.norm(normal, axis=1)[:, None]
    forwards = np.einsum("kni,kni->kn", np.roll(following, 1, axis=1), following)
    turned = np.arctan2(sine, np.linalg.norm(normal, axis=1)[:, None] * forwards).sum(axis=1)
    convex = np.all(sine > least, axis=1) & (turned < 3 * np.pi)  # a star turns twice
    n = np.arange(1, faces.shape[1] - 1)
    fans = np.column_stack([0 * n, n, n + 1])
    found = [faces[convex][:, fans].reshape(-1, 3)]
    found += [_clipped(points, face) for face in faces[~convex]]
    return np.concatenate(found)


def _area(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the area vectors (k, 3) of polygons (k, n, 3), by Newell's method."""
    aside = corners - corners[:, :1]
    return np.cross(aside, np.roll(aside, -1, axis=1)).sum(axis=1)


def _halves(corners: NDArray[np.float64], faces: Indices) -> Indices:
    """Divide quadrilaterals (k, 4) by the diagonal whose halves face more alike.

    That lies inside if one corner turns inwards, and leaves no half without an area.
    """
    normal = _area(corners)
    ways = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])
    worst = []
    for way in ways:
        halves = [np.einsum("ki,ki->k", _area(corners[:, half]), normal) for half in way]
        worst.append(np.minimum(*halves))
    way = ways[np.argmax(worst, axis=0)]
    return np.take_along_axis(faces[:, None], way.reshape(-1, 2, 3), axis=2).reshape(-1, 3)


def _clipped(points: NDArray[np.float64], face: Indices) -> Indices:
    """Return the triangles of a polygon of any shape, in its plane."""
    corners = points[face]
    normal = _area(corners[None])[0]
    if not normal.any():
        return np.column_stack([np.broadcast_to(face[0], len(face) - 2), face[1:-1], face[2:]])
    axes = np.linalg.svd(normal[None])[2][1:]
    if np.cross(*axes) @ normal < 0:
        axes = axes[::-1]
    flat = (corners - corners[0]) @ axes.T
    number = {
        tuple(place): corner for place, corner in zip(flat.tolist(), face.tolist(), strict=True)
    }
    try:
        parts = shapely.constrained_delaunay_triangles(shapely.Polygon(flat))
    except shapely.GEOSException:
        parts = shapely.GeometryCollection()
    area, size = np.linalg.norm(normal) / 2, np.ptp(flat)
    if abs(parts.area - area) > _AREA * area + _SLIVER * size**2:
        x, y, z = corners[0]
        raise ValueError(f"the sides of its face at {x:.3g}, {y:.3g}, {z:.3g} cross")
    rings = [list(part.exterior.coords)[:3] for part in shapely.orient_polygons(parts).geoms]
    return np.array([[number[corner] for corner in ring] for ring in rings], dtype=np.int64)


# --- files -------------------------------------------------------------------------------------


def read_obj(data: bytes) -> Polygons:
    """Read the vertices and faces of an OBJ file; all else is ignored.

    Raises
    ------
    ValueError
        It is damaged.
    """
    points, corners, counts = [], [], []
    text = data.decode("utf-8-sig", errors="replace")
    for line in re.sub(r"\\\r?\n", "", text).splitlines():
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0] == "v":
            points.append([float(word) for word in words[1:4]])
        elif words[0] in ("f", "fo"):
            face = [int(word.partition("/")[0]) for word in words[1:]]
            if 0 in face:
                raise ValueError("a face has the corner 0, but they are counted from 1")
            # Negative ones are counted back from the last vertex so far.
            corners += [k - 1 if k > 0 else len(points) + k for k in face]
            counts.append(len(face))
    return Polygons(
        np.array(points, dtype=float).reshape(-1, 3),
        np.array(corners, dtype=np.int64),
        np.array(counts, dtype=np.int64),
    )


def read_ply(data: bytes) -> Polygons:
    """Read the vertices and faces of a PLY file; all else is ignored.

    Raises
    ------
    ValueError
        It is damaged.
    """
    head = re.match(rb"ply\s.*?\nend_header[ \t]*\r?\n", data, re.DOTALL)
    kind = re.search(rb"\nformat[ \t]+(ascii|binary_little_endian|binary_big_endian)\s", data)
    if not head or not kind:
        raise ValueError("it has no header")
    order = ">" if kind[1] == b"binary_big_endian" else "<"
    numbers = Numbers(data[head.end() :], kind[1] == b"ascii", order)
    columns: dict[str, dict[str, Column]] = {}
    for name, count, properties in _elements(head[0].decode("latin-1")):
        columns[name] = _columns(numbers, count, properties)
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    if not {"x", "y", "z"} <= vertex.keys():
        raise ValueError("it has no vertices")
    empty = np.zeros(0, np.int64), np.zeros(0, np.int64)
    corners, counts = face.get("vertex_indices", face.get("vertex_index", empty))
    points = np.column_stack([vertex[axis][0] for axis in "xyz"]).astype(float)
    return Polygons(points, corners.astype(np.int64), counts)


# Values of a property, those of lists after each other, and how many belong to each element.
Column = tuple[NDArray, Indices]
# Its name, the type of its values and, of lists, that of the counts.
Property = tuple[str, str, str | None]


def _elements(header: str) -> list[tuple[str, int, list[Property]]]:
    """Return name, number and properties of the elements that a PLY file announces."""
    found: list[tuple[str, int, list[Property]]] = []
    for line in header.splitlines():
        match line.split():
            case ["element", name, count]:
                found.append((name, int(count), []))
            case ["property", "list", count, kind, name]:
                found[-1][2].append((name, _TYPES[kind], _TYPES[count]))
            case ["property", kind, name]:
                found[-1][2].append((name, _TYPES[kind], None))
    return found


def _columns(numbers: Numbers, count: int, properties: list[Property]) -> dict[str, Column]:
    """Take elements, in runs whose lists are as long as those of the first of the run."""
    parts: dict[str, list[Column]] = {name: [] for name, _, _ in properties}
    while count > 0:
        lengths = _lengths(numbers, properties)
        fields = []
        for name, kind, counted in properties:
            if counted:
                fields.append((f"#{name}", numbers.type_of(counted)))
            fields.append((name, numbers.type_of(kind), (lengths[name],)))
        stated = {f"#{name}": lengths[name] for name, _, counted in properties if counted}
        rows = numbers.alike(np.dtype(fields), count, stated)
        for name, _, _ in properties:
            parts[name].append((rows[name].ravel(), np.full(len(rows), lengths[name])))
        count -= len(rows)
    return {
        name: (np.concatenate([v for v, _ in part]), np.concatenate([n for _, n in part]))
        for name, part in parts.items()
        if part
    }


def _lengths(numbers: Numbers, properties: list[Property]) -> dict[str, int]:
    """Return how many values each property of the next element has."""
    lengths: dict[str, int] = {}
    fields: list[tuple] = []
    for name, kind, counted in properties:
        lengths[name] = 1
        if counted:
            fields.append((f"#{name}", numbers.type_of(counted)))
            lengths[name] = int(numbers.peek(np.dtype(fields), 1)[f"#{name}"][0])
        fields.append((name, numbers.type_of(kind), (lengths[name],)))
    return lengths
