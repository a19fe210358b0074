"""Reads triangulated surfaces, as scanners, segmentations and CAD programs write them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.runtime.polygons import read_obj, read_ply

FORMATS = ("stl", "obj", "ply")
MOST_TRIANGLES = 500_000  # half a GB of memory while they are read
MOST_BYTES = 40_000_000
_LONGEST_MM = 1e6  # a kilometre: certainly a wrong unit
_MERGED_DIGITS = 5  # of mm: corners that agree so far are one vertex
_STL_HEADER, _STL_TRIANGLE = 84, 50  # bytes: a comment and the number of triangles; each of them


@dataclass(frozen=True)
class Triangles:
    """A triangulated surface, open or closed.

    Parameters
    ----------
    points
        (n, 3) vertices in mm; each is used, and no two are equal.
    triangles
        (m, 3) corners; none is degenerate.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]

    def edges(self) -> NDArray[np.int64]:
        """Return the directed edges (3 m, 2) of all triangles."""
        following = np.roll(self.triangles, -1, axis=1)
        return np.stack([self.triangles, following], axis=-1).reshape(-1, 2)

    def outwards(self) -> Triangles:
        """Return the surface facing outwards on the whole; itself if it does."""
        a, b, c = np.moveaxis(self.points[self.triangles] - self.points.mean(axis=0), 1, 0)
        if np.einsum("ni,ni->", a, np.cross(b, c)) > 0:
            return self
        return Triangles(self.points, self.triangles[:, ::-1].copy())


def read_triangles(file: Path, field: str, unit_mm: float) -> Triangles:
    """Read an STL, OBJ or PLY file; polygons are divided, materials, colours, normals ignored.

    Parameters
    ----------
    file
        The surface.
    field
        Name of the file's key in the study, for messages.
    unit_mm
        Length of the file's unit in mm.

    Raises
    ------
    StudyError
        The file is missing, damaged, too large or empty, or its coordinates are no lengths.
    """
    start = f"{field} = {file}"
    kind = file.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise StudyError(f"{start} must be a surface of triangles: a .stl, .obj or .ply file.")
    if not file.is_file():
        what = "is no file" if file.exists() else "does not exist"
        raise StudyError(f"{start} {what}.")
    try:
        _refuse_too_large(file, kind, start)
        points, triangles = (_read_stl if kind == "stl" else _read_polygons)(file)
        points = points * unit_mm
    except OSError as error:
        raise StudyError(f"{start} cannot be read: {error.strerror}.") from None
    except StudyError:
        raise
    except Exception as error:  # a damaged file fails in many ways
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise StudyError(
            f"{start} cannot be read: it is no .{kind} file, or damaged ({reason})."
        ) from error
    return _merged(points, triangles, start)


def _read_stl(file: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the corners of a file's triangles and, of each triangle, which they are."""
    import trimesh  # takes 0.15 s, and most studies have no such file

    with file.open("rb") as stream:
        # Unprocessed: trimesh would drop triangles with NaN, and merge in the file's unit.
        mesh = trimesh.load_mesh(stream, file_type="stl", process=False)
    return (
        np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3),
        np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3),
    )


def _read_polygons(file: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices of an OBJ or PLY file, and its faces divided into triangles."""
    read = read_ply if file.suffix.lower() == ".ply" else read_obj
    polygons = read(file.read_bytes())
    return polygons.points, polygons.triangles()


def _refuse_too_large(file: Path, kind: str, start: str) -> None:
    """Refuse a file by its size and header, before it is read."""
    size = file.stat().st_size
    if size == 0:
        raise StudyError(f"{start} is empty.")
    with file.open("rb") as stream:
        head = stream.read(10_000)
    count = 0
    if kind == "stl":
        count = _stl_triangles(file, size, head, start)
    elif kind == "ply" and (found := re.search(rb"element\s+face\s+(\d{1,20})", head)):
        count = int(found[1])
    if count > MOST_TRIANGLES:
        raise StudyError(
            f"{start} has {count} triangles, but at most {MOST_TRIANGLES} can be read: simplify it."
        )
    if size > MOST_BYTES:
        raise StudyError(
            f"{start} is {size / 1e6:.0f} MB large, but at most {MOST_BYTES / 1e6:.0f} MB can be "
            "read: simplify it, or save it in binary form."
        )


def _stl_triangles(file: Path, size: int, head: bytes, start: str) -> int:
    """Return the number of triangles that a binary file states, 0 for text; refuse a part of one.

    A binary file is as long as its header says; its comment may start with "solid" like text.
    """
    count = int.from_bytes(head[_STL_HEADER - 4 : _STL_HEADER], "little")
    if size == _STL_HEADER + _STL_TRIANGLE * count:
        return count
    if head.lstrip()[:5].lower() != b"solid":
        raise StudyError(
            f"{start} is no .stl file, or cut off: it has {size} bytes, not the "
            f"{_STL_HEADER + _STL_TRIANGLE * count} that its header announces."
        )
    with file.open("rb") as stream:
        stream.seek(max(size - 1000, 0))
        if b"endsolid" not in stream.read().lower():  # trimesh would not mind
            raise StudyError(f"{start} is cut off: it does not end with endsolid.")
    return 0


def _merged(points: NDArray[np.float64], triangles: NDArray[np.int64], start: str) -> Triangles:
    """Check the coordinates and merge equal vertices."""
    if len(triangles) == 0:
        raise StudyError(f"{start} contains no triangles.")
    if len(triangles) > MOST_TRIANGLES:
        raise StudyError(
            f"{start} has {len(triangles)} triangles, but at most {MOST_TRIANGLES} can be read: "
            "simplify it."
        )
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise StudyError(f"{start} is damaged: triangles have corners that it does not contain.")
    corners = points[triangles.ravel()]
    if not np.all(np.isfinite(corners)):
        raise StudyError(f"{start} has coordinates that are no finite numbers.")
    low, high = corners.min(axis=0), corners.max(axis=0)
    if max(np.abs(low).max(), np.abs(high).max()) > _LONGEST_MM:
        raise StudyError(
            f"{start} has coordinates of {max(np.abs(low).max(), np.abs(high).max()):g} mm, but at "
            f"most {_LONGEST_MM:g} mm are allowed: is its unit right?"
        )
    rounded = np.round(corners, _MERGED_DIGITS)
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    faces = number.reshape(-1, 3).astype(np.int64)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) == 0:
        raise StudyError(f"{start} contains no triangles with an area: is its unit right?")
    used, flat = np.unique(faces, return_inverse=True)
    return Triangles(corners[first][used], flat.reshape(-1, 3).astype(np.int64))
