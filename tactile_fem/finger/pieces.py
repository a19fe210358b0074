"""What of scanned surfaces belongs to the finger: not islands beside it, not the rest of a hand."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tactile_fem.finger.shape import Array
from tactile_fem.runtime.triangles import Triangles

logger = logging.getLogger(__name__)

# A piece with less of the largest one's area is an island: dirt, or noise of the scanner.
_ISLAND = 0.05


def without_islands(surface: Triangles, field: str, at: Array | None = None) -> Triangles:
    """Return a scan without small pieces, and with a warning of them.

    Parameters
    ----------
    surface
        In any axes.
    field
        The key of its file, for messages.
    at
        (3,) a place: what does not surround the piece that is next to it is left out as well.
    """
    piece = _pieces(surface)
    a, b, c = np.moveaxis(surface.points[surface.triangles], 1, 0)
    area = np.bincount(piece, np.linalg.norm(np.cross(b - a, c - a), axis=1))
    kept = area >= _ISLAND * area.max()
    main = int(np.argmax(area))
    if at is not None:
        main = _next_to(surface, np.where(kept[piece], piece, -1), at)
        kept &= _surrounded(surface, piece, main)
    if kept.all():
        return surface
    logger.warning(
        "%s has %d separate pieces: %d of them, %.2g %% of the area, are left out.",
        field,
        len(kept),
        np.count_nonzero(~kept),
        100 * area[~kept].sum() / area.sum(),
    )
    return _part(surface, kept[piece])


def beyond(surface: Triangles, least_y: float) -> Triangles:
    """Return the triangles of a surface that reach beyond some Y; itself if all do."""
    inside = surface.points[surface.triangles, 1].max(axis=1) > least_y
    return surface if inside.all() else _part(surface, inside)


def connected(surface: Triangles, at: Array) -> Triangles:
    """Return the piece that is next to a place (3,), with what lies within it."""
    piece = _pieces(surface)
    return _part(surface, _surrounded(surface, piece, _next_to(surface, piece, at))[piece])


def _pieces(surface: Triangles) -> NDArray[np.int64]:
    """Return the number of the connected piece of each triangle, (m,)."""
    n, (a, b, c) = len(surface.points), surface.triangles.T
    one, other = np.concatenate([a, b]), np.concatenate([b, c])
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(n, n))
    return connected_components(graph, directed=False)[1][a].astype(np.int64)


def _next_to(surface: Triangles, piece: NDArray[np.int64], at: Array) -> int:
    """Return the piece with the vertex next to a place; negative ones do not count."""
    distance = np.linalg.norm(surface.points - at, axis=1)[surface.triangles].min(axis=1)
    return int(piece[np.argmin(np.where(piece < 0, np.inf, distance))])


def _surrounded(surface: Triangles, piece: NDArray[np.int64], main: int) -> NDArray[np.bool_]:
    """Return which pieces have their middle in the box of one of them."""
    corners = surface.points[surface.triangles]
    low, high = np.full((piece.max() + 1, 3), np.inf), np.full((piece.max() + 1, 3), -np.inf)
    np.minimum.at(low, piece, corners.min(axis=1))
    np.maximum.at(high, piece, corners.max(axis=1))
    middle = (low + high) / 2
    return np.all((middle >= low[main]) & (middle <= high[main]), axis=1)


def _part(surface: Triangles, kept: NDArray[np.bool_]) -> Triangles:
    used, flat = np.unique(surface.triangles[kept], return_inverse=True)
    return Triangles(surface.points[used], flat.reshape(-1, 3).astype(np.int64))
