"""The files of a scanned finger: what of them belongs to the finger, in the finger's axes."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tactile_fem.errors import MeshError
from tactile_fem.finger.frame import Frame, frame_of
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.simplex import Indices
from tactile_fem.runtime.triangles import Triangles, read_triangles

logger = logging.getLogger(__name__)

_SIZES_MM = 4.0, 300.0  # of skin, bone and nail
# A piece with less of the largest one's area is an island: dirt, or noise of the scanner.
_ISLAND_SHARE = 0.05


@dataclass(frozen=True)
class Scans:
    """The surfaces of a finger in its own axes, None where the study has no file.

    `frame` has these axes in the files' coordinates.
    """

    skin: Triangles | None
    bone: Triangles | None
    nail: Triangles | None
    frame: Frame

    @classmethod
    def of(cls, finger: Finger) -> Scans:
        """Read a finger's files and find its axes.

        Raises
        ------
        StudyError, MeshError
            A file cannot be read, or the axes are not found.
        """
        at = None if finger.contact_mm is None else np.array(finger.contact_mm)
        found: dict[str, Triangles | None] = {}
        for name in ("skin", "bone", "nail"):
            file, field = getattr(finger, f"{name}_file"), f"finger.{name}_file"
            surface = file and _without_islands(_read(file, field, finger), field, at)
            found[name] = surface and surface.outwards()
        frame = frame_of(finger, **found)
        placed = {
            name: surface and replace(surface, points=frame.to_finger(surface.points))
            for name, surface in found.items()
        }
        return cls(**placed, frame=frame)


def _read(file: Path, field: str, finger: Finger) -> Triangles:
    """Read a surface; raise MeshError if it cannot be that of a finger."""
    surface = read_triangles(file, field, finger.file_unit_mm)
    size, (least, most) = float(np.ptp(surface.points, axis=0).max()), _SIZES_MM
    if not least < size < most:
        raise MeshError(
            f"finger.file_unit_mm = {finger.file_unit_mm:g} makes the surface in {file} "
            f"{size:.3g} mm long, but it must be {least:g} to {most:g} mm"
        )
    return surface


def beyond(surface: Triangles, least_y: float) -> Triangles:
    """Return the triangles of a surface that reach beyond some Y; itself if all do."""
    return surface.part(surface.corners[..., 1].max(axis=1) > least_y)


def connected(surface: Triangles, at: Array) -> Triangles:
    """Return the piece that is next to a place (3,), with what lies within it."""
    piece = _pieces(surface)
    return surface.part(_surrounded(surface, piece, _next_to(surface, piece, at))[piece])


def _without_islands(surface: Triangles, field: str, at: Array | None) -> Triangles:
    """Return a scan without small pieces, and with a warning of them.

    If `at` (3,) is a place, what does not surround the piece next to it is left out as well.
    """
    piece = _pieces(surface)
    area = np.bincount(piece, surface.areas)
    kept = area >= _ISLAND_SHARE * area.max()
    if at is not None:
        main = _next_to(surface, np.where(kept[piece], piece, -1), at)
        kept &= _surrounded(surface, piece, main)
    if not kept.all():
        logger.warning(
            "%s has %d separate pieces: %d of them, %.2g %% of the area, are left out.",
            field,
            len(kept),
            np.count_nonzero(~kept),
            100 * area[~kept].sum() / area.sum(),
        )
    return surface.part(kept[piece])


def _pieces(surface: Triangles) -> Indices:
    """Return the number of the connected piece of each triangle, (m,)."""
    n, (a, b, c) = len(surface.points), surface.triangles.T
    one, other = np.concatenate([a, b]), np.concatenate([b, c])
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(n, n))
    return connected_components(graph, directed=False)[1][a].astype(np.int64)


def _next_to(surface: Triangles, piece: Indices, at: Array) -> int:
    """Return the piece with the vertex next to a place; negative ones do not count."""
    distance = np.linalg.norm(surface.points - at, axis=1)[surface.triangles].min(axis=1)
    return int(piece[np.argmin(np.where(piece < 0, np.inf, distance))])


def _surrounded(surface: Triangles, piece: Indices, main: int) -> NDArray[np.bool_]:
    """Return which pieces have their middle in the box of one of them."""
    low, high = np.full((piece.max() + 1, 3), np.inf), np.full((piece.max() + 1, 3), -np.inf)
    np.minimum.at(low, piece, surface.corners.min(axis=1))
    np.maximum.at(high, piece, surface.corners.max(axis=1))
    middle = (low + high) / 2
    return np.all((middle >= low[main]) & (middle <= high[main]), axis=1)
