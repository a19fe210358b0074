"""Reads triangulated surfaces, as scanners, segmentations and CAD programs write them.

trimesh reads STL files, of either kind. OBJ and PLY files are read here: trimesh divides each
polygon like a fan, which is wrong if it is not convex, counts negative indices of OBJ from the end
of the file, and reads no binary PLY whose faces differ in length.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger import Triangles as Surface

Array = NDArray[Any]
Points = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_TRIANGLES = 500_000  # half a GB of memory while they are read
MOST_BYTES = 40_000_000
# A second or two; libigl builds its trees anew for each part, at most a second of that.
_CHUNK_POINTS = 50_000
_MAX_COORDINATE_MM = 1e6  # a kilometre: certainly a wrong unit
_VERTEX_DECIMALS = 5  # of mm: corners that agree so far are one vertex
_STL_HEADER, _STL_TRIANGLE = 84, 50  # bytes: a comment and the number of triangles; each of them


@dataclass(frozen=True)
class Triangles(Surface):
    """A surface of which each vertex is used, no two are equal, and no triangle is degenerate."""

    @property
    def areas(self) -> Points:
        """Areas of the triangles, (m,) mm^2."""
        return np.linalg.norm(self.area_vectors, axis=1)

    def moved(self, by: Points) -> Self:
        """Return the surface moved by (3,) mm."""
        return replace(self, points=self.points + by)

    def part(self, kept: NDArray[np.bool_]) -> Self:
        """Return some triangles (m,) and their vertices; itself if it is all of them."""
        if kept.all():
            return self
        used, flat = np.unique(self.triangles[kept], return_inverse=True)
        return replace(self, points=self.points[used], triangles=flat.reshape(-1, 3))

    def edges(self) -> Indices:
        """Return the directed edges (3 m, 2) of all triangles."""
        following = np.roll(self.triangles, -1, axis=1)
        return np.stack([self.triangles, following], axis=-1).reshape(-1, 2)

    def outwards(self) -> Self:
        """Return the surface facing outwards on the whole; itself if it does."""
        a, b, c = np.moveaxis(self.points[self.triangles] - self.points.mean(axis=0), 1, 0)
        if np.einsum("ni,ni->", a, np.cross(b, c)) > 0:
            return self
        return replace(self, triangles=self.triangles[:, ::-1].copy())


def read_triangles(file: Path, field: str, unit_mm: float) -> Triangles:
    """Read an STL, OBJ or PLY file; polygons are divided, materials, colours, normals ignored.

    `field` is the name of the file's key in the study, for the StudyError that is raised if the
    file is missing, damaged, too large or empty, or if its coordinates are no lengths.
    """
    start = f"{field} = {file}"
    kind = file.suffix.lower().removeprefix(".")
    readers = {"stl": _read_stl, "obj": _read_obj, "ply": _read_ply}
    if kind not in readers:
        raise StudyError(f"{start} must be a surface of triangles: a .stl, .obj or .ply file.")
    if not file.is_file():
        what = "is no file" if file.exists() else "does not exist"
        raise StudyError(f"{start} {what}.")
    try:
        _refuse_too_large(file, kind, start)
        polygons = readers[kind](file.read_bytes())
        triangles = _triangles(*polygons)
    except OSError as error:
        raise StudyError(f"{start} cannot be read: {error.strerror}.") from None
    except StudyError:
        raise
    except Exception as error:  # a damaged file fails in many ways
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise StudyError(
            f"{start} cannot be read: it is no .{kind} file, or damaged ({reason})."
        ) from error
    return _merged(polygons.points * unit_mm, triangles, start)


def _refuse_too_large(file: Path, kind: str, start: str) -> None:
    """Refuse a file by its size and header, before it is read."""
    size = file.stat().st_size
    if size == 0:
        raise StudyError(f"{start} is empty.")
    with file.open("rb") as stream:
        head = stream.read(10_000)
    if kind == "stl" and size == _stl_bytes(head):
        _refuse_many((size - _STL_HEADER) // _STL_TRIANGLE, start)
    elif kind == "ply" and (found := re.search(rb"element\s+face\s+(\d{1,20})", head)):
        _refuse_many(int(found[1]), start)
    if size > MOST_BYTES:
        raise StudyError(
            f"{start} is {size / 1e6:.0f} MB large, but at most {MOST_BYTES / 1e6:.0f} MB can be "
            "read: simplify it, or save it in binary form."
        )


def _refuse_many(triangles: int, start: str) -> None:
    if triangles > MOST_TRIANGLES:
        raise StudyError(
            f"{start} has {triangles} triangles, but at most {MOST_TRIANGLES} can be read: "
            "simplify it."
        )


def _stl_bytes(head: bytes) -> int:
    """Return the length of a binary file by its header, whose comment may start with "solid"."""
    count = int.from_bytes(head[_STL_HEADER - 4 : _STL_HEADER], "little")
    return _STL_HEADER + _STL_TRIANGLE * count


def _merged(points: Points, triangles: Indices, start: str) -> Triangles:
    """Check the size and merge equal vertices."""
    if len(triangles) == 0:
        raise StudyError(f"{start} contains no triangles.")
    _refuse_many(len(triangles), start)
    corners = points[triangles.ravel()]
    largest = np.abs(corners).max()
    if largest > _MAX_COORDINATE_MM:
        raise StudyError(
            f"{start} has coordinates of {largest:g} mm, but at most {_MAX_COORDINATE_MM:g} mm are "
            "allowed: is its unit right?"
        )
    rounded = np.round(corners, _VERTEX_DECIMALS)
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    faces = number.reshape(-1, 3).astype(np.int64)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) == 0:
        raise StudyError(f"{start} contains no triangles with an area: is its unit right?")
    used, flat = np.unique(faces, return_inverse=True)
    return Triangles(corners[first][used], flat.reshape(-1, 3).astype(np.int64))


def in_chunks(evaluate: Callable[[Points], Sequence[Array]], points: Points) -> tuple[Array, ...]:
    """Return what a function returns for points (n, d), arrays (n, ...), evaluated in parts.

    Signals are answered between the parts.
    """
    starts = range(0, max(len(points), 1), _CHUNK_POINTS)
    parts = [evaluate(points[start : start + _CHUNK_POINTS]) for start in starts]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


# --- polygons ------------------------------------------------------------------------------------

# Largest difference between the area of a face and that of its triangles: share of the area, and
# of its size's square.
_AREA_ERROR, _AREA_ERROR_OF_SIZE = 1e-6, 1e-9


class _Polygons(NamedTuple):
    """Points (n, 3), and faces: their corners one after the other, and how many each has."""

    points: Points
    corners: Indices
    counts: Indices


def _triangles(points: Points, corners: Indices, counts: Indices) -> Indices:
    """Divide faces into triangles (m, 3); faces of less than three corners are left out.

    It raises ValueError if a face has corners that do not exist, or if its sides cross.
    """
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
        raise ValueError("faces have corners that it does not contain")
    if not np.all(np.isfinite(points[corners])):
        raise ValueError("coordinates are no finite numbers")
    first = np.cumsum(counts) - counts
    found = [np.zeros((0, 3), np.int64)]
    for count in np.unique(counts[counts > 2]).tolist():
        faces = corners[first[counts == count][:, None] + np.arange(count)]
        if count == 4:
            faces = _halves(points, faces)
        elif count > 4:
            faces = _divided(points, faces)
        found.append(faces)
    return np.concatenate(found)


def _area(corners: Points) -> Points:
    """Return twice the area vectors (k, 3) of polygons (k, n, 3), by Newell's method."""
    aside = corners - corners[:, :1]
    return np.cross(aside, np.roll(aside, -1, axis=1)).sum(axis=1)


def _halves(points: Points, faces: Indices) -> Indices:
    """Divide quadrilaterals (k, 4) by the diagonal whose halves face more alike.

    It lies inside if one corner turns inwards, and neither half is degenerate.
    """
    corners = points[faces]
    normal = _area(corners)
    diagonals = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])
    worse = [
        np.min([np.einsum("ki,ki->k", _area(corners[:, half]), normal) for half in halves], axis=0)
        for halves in diagonals
    ]
    halves = diagonals[np.argmax(worse, axis=0)]
    return np.take_along_axis(faces[:, None], halves.reshape(-1, 2, 3), axis=2).reshape(-1, 3)


def _divided(points: Points, faces: Indices) -> Indices:
    """Divide faces (k, n) of five or more corners and of any shape, each in its plane."""
    import shapely  # takes a while

    def parts_of(polygon: shapely.Polygon) -> shapely.GeometryCollection:
        try:
            return shapely.constrained_delaunay_triangles(polygon)
        except shapely.GEOSException:
            return shapely.GeometryCollection()

    corners = points[faces]
    normal = _area(corners)
    axes = np.linalg.svd(normal[:, None])[2][:, 1:]
    flat = np.einsum("kni,kji->knj", corners - corners[:, :1], axes)
    parts = np.array([parts_of(polygon) for polygon in shapely.polygons(flat)])
    area, size = np.linalg.norm(normal, axis=1) / 2, np.ptp(flat, axis=(1, 2))
    error = np.abs(shapely.area(parts) - area)
    if np.any(wrong := error > _AREA_ERROR * area + _AREA_ERROR_OF_SIZE * size**2):
        x, y, z = corners[wrong.argmax(), 0]
        raise ValueError(f"the sides of its face at {x:.3g}, {y:.3g}, {z:.3g} cross")
    triangles, face = shapely.get_parts(parts, return_index=True)
    places = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    # The corners of the triangles are those of their face.
    own = np.column_stack([np.repeat(np.arange(len(faces)), faces.shape[1]), flat.reshape(-1, 2)])
    of_parts = np.column_stack([np.repeat(face, 3), places.reshape(-1, 2)])
    _, place = np.unique(np.vstack([own, of_parts]), axis=0, return_inverse=True)
    number = np.empty(len(place), np.int64)
    number[place[: len(own)]] = faces.ravel()
    found = number[place[len(own) :]].reshape(-1, 3)
    turned = np.einsum("ki,ki->k", _area(points[found]), normal[face]) < 0
    found[turned] = found[turned, ::-1]
    # Faces on a line keep the surface closed.
    spokes = np.arange(1, faces.shape[1] - 1)
    fan = faces[area == 0][:, np.column_stack([0 * spokes, spokes, spokes + 1])]
    return np.concatenate([found, fan.reshape(-1, 3)])


# --- files ---------------------------------------------------------------------------------------

# PLY's names of types that are not NumPy's.
_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8"},
}
_COUNT = "number of "  # and the name of a list: how many values it has


def _read_stl(data: bytes) -> _Polygons:
    import trimesh  # takes 0.15 s, and most studies have no such file

    if len(data) != (announced := _stl_bytes(data)):
        if data.lstrip()[:5].lower() != b"solid":
            raise ValueError(f"cut off: {len(data)} bytes, not its header's {announced}")
        if b"endsolid" not in data[-1000:].lower():  # trimesh would not mind
            raise ValueError("cut off: it does not end with endsolid")
    # Unprocessed: trimesh would drop triangles with NaN, and merge in the file's unit.
    mesh = trimesh.load_mesh(io.BytesIO(data), file_type="stl", process=False)
    points = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    corners = np.asarray(mesh.faces, dtype=np.int64)
    return _Polygons(points, corners.ravel(), np.full(len(corners), 3))


def _read_obj(data: bytes) -> _Polygons:
    """Read the vertices and faces of an OBJ file; all else is ignored."""
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
    return _Polygons(
        np.array(points, dtype=float).reshape(-1, 3),
        np.array(corners, dtype=np.int64),
        np.array(counts, dtype=np.int64),
    )


def _read_ply(data: bytes) -> _Polygons:
    """Read the vertices and faces of a PLY file; all else is ignored."""
    head = re.match(rb"ply\s.*?\nend_header[ \t]*\r?\n", data, re.DOTALL)
    kind = re.search(rb"\nformat[ \t]+(ascii|binary_little_endian|binary_big_endian)\s", data)
    if not head or not kind:
        raise ValueError("it has no header")
    numbers, at = data[head.end() :], 0
    is_text, is_big = (kind[1] == name for name in (b"ascii", b"binary_big_endian"))
    if is_text:  # then all numbers are doubles
        numbers = np.array(numbers.split(), dtype="<f8").tobytes()

    def type_of(name: str) -> np.dtype:
        own = np.dtype(_PLY_TYPES.get(name, name))
        return np.dtype("<f8") if is_text else own.newbyteorder(">" if is_big else "<")

    elements: dict[str, tuple[int, list[tuple[str, np.dtype]]]] = {}
    for line in head[0].decode("latin-1").splitlines():
        match line.split():
            case ["element", name, count]:
                elements[name] = int(count), (properties := [])
            case ["property", "list", count, kind_of_values, name]:
                properties += [(_COUNT + name, type_of(count)), (name, type_of(kind_of_values))]
            case ["property", kind_of_values, name]:
                properties.append((name, type_of(kind_of_values)))
    found: dict[str, list[Array]] = {}
    for element, (number, properties) in elements.items():
        found[element], at = _ply_records(numbers, at, number, properties)
    vertices, faces = found.get("vertex", []), found.get("face", [])
    if not vertices or not {"x", "y", "z"} <= set(vertices[0].dtype.names or ()):
        raise ValueError("it has no vertices")
    points = [np.column_stack([some[axis] for axis in "xyz"]).astype(float) for some in vertices]
    corners, counts = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for some in faces:
        name = next(n for n in ("vertex_indices", "vertex_index") if n in (some.dtype.names or ()))
        corners.append(some[name].ravel().astype(np.int64))
        counts.append(np.full(len(some), some[name].shape[1]))
    return _Polygons(np.concatenate(points), np.concatenate(corners), np.concatenate(counts))


def _ply_records(
    data: bytes, at: int, count: int, properties: list[tuple[str, np.dtype]]
) -> tuple[list[Array], int]:
    """Return elements from a place on, in runs whose lists are alike long, and where they end."""
    runs, ahead = [], 1
    while count > 0:
        fields: list[Any] = []
        lengths: dict[str, int] = {}
        for name, kind in properties:
            length = lengths.get(_COUNT + name, 1)
            if name.startswith(_COUNT):
                lengths[name] = int(np.frombuffer(data, kind, 1, at + np.dtype(fields).itemsize)[0])
            fields.append((name, kind, (length,)))
        record = np.dtype(fields)
        most = min(ahead, count, (len(data) - at) // record.itemsize)
        rows = np.frombuffer(data, record, most, at)
        alike = np.ones(len(rows), dtype=bool)
        for name, length in lengths.items():
            alike &= rows[name][:, 0] == length
        run = len(rows) if alike.all() else int(np.argmin(alike))
        if not run:
            raise ValueError("it is cut off")
        runs.append(rows[:run])
        at, count, ahead = at + run * record.itemsize, count - run, 8 * run + 1
    return runs, at
