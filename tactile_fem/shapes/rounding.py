"""The signed distance of a solid of triangles whose edges are rounded, on a lattice.

Opening by the radius r rounds convex edges, closing rounds concave ones: the points deeper than r
are a first set, what is within 2 r of it a second set, and the rounded solid is what is deeper
than r in the second. Each set is a level set of the distance to the one before.
"""

from __future__ import annotations

from dataclasses import replace

import igl
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tactile_fem.errors import StudyError
from tactile_fem.shapes.contour import Lattice, Near, level_set
from tactile_fem.shapes.surface_files import Array, Triangles, in_chunks
from tactile_fem.stimulus import linear_between

# In steps of the lattice: how far a cell's corners may be from a surface that crosses it, and the
# error of `Lattice.spread`.
_CELL_STEPS, _SPREAD_STEPS = 1.75, 2.0
# If following the gradient ends this far off the level set, in steps, an edge is nearest.
_EDGE_STEPS = 0.25
# Error of a rounded distance, in steps, where nothing is to be rounded.
_NOISE_STEPS = 0.03
_UNKNOWN_MM = 1e3


def rounded_distance(
    solid: Triangles, lattice: Lattice, radius: float, reach: float
) -> tuple[Array, Array]:
    """Return the signed distance of the rounded solid on a lattice, mm, and points (n, 3) of it.

    The points lie `radius` below the surface; wherever a ball of this radius fits, one is near.

    The distance is exact up to the lattice's resolution of edges from `radius` below the surface to
    `reach` above it, and continued roughly beyond. Edges that turn by less than some 20 degrees,
    such as those of a curved surface's triangles, are left to the lattice, whose step is half the
    radius at most. Where the solid goes on beyond the lattice, what is less than four radii from
    its end is not rounded properly; nor are walls and gaps less than two steps wider than twice the
    radius.

    Raises
    ------
    StudyError
        Parts of the surface overlap or face inwards, or none is as thick as twice the radius.
    """
    h = lattice.step
    spread = lattice.spread(fine(solid, lattice.origin, lattice.end, h).points)
    inside = _inside(solid, lattice, spread > _SPREAD_STEPS * h)
    value = np.where(inside & (spread > radius), -np.inf, np.inf)
    farthest = np.where(inside, radius, max(reach, radius)) + (_CELL_STEPS + _SPREAD_STEPS) * h
    sharp = _signed(solid, lattice, value, spread < farthest)
    core = level_set(sharp, -radius)
    if not len(core.triangles):
        raise too_thin(radius)
    in_core = sharp.value < -radius
    grown = sharp.raised(radius)
    grown = _replaced(grown, core, _near_edges(grown) & ~in_core, 1.0)

    shell = level_set(grown, 2 * radius)
    in_shell = grown.value < 2 * radius
    shrunk = grown.raised(-2 * radius)
    filled = _near_edges(shrunk) & in_shell & ~in_core
    shrunk = _replaced(shrunk, shell, filled, -1.0)
    distance = np.where(sharp.known, _exact_off_edges(shrunk.value + radius, sharp.value, h), 0.0)
    return _continued(distance, sharp.known, inside, h), core.points


def fine(solid: Triangles, low: Array, high: Array, longest: float) -> Triangles:
    """Return what of a surface lies in a box, in triangles with edges of at most `longest` mm."""
    import trimesh  # takes 0.15 s, and most stimulators are not rounded so

    mesh = trimesh.Trimesh(solid.points, solid.triangles, process=False)
    normals = np.vstack([np.eye(3), -np.eye(3)])
    cut = mesh.slice_plane(np.vstack([[low] * 3, [high] * 3]), normals)
    points, triangles = trimesh.remesh.subdivide_to_size(
        cut.vertices, cut.faces, longest, max_iter=30
    )
    return Triangles(points, triangles)


def _inside(solid: Triangles, lattice: Lattice, clear: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points clear of the surface are inside, by one winding number per region."""
    region, count = ndimage.label(clear)
    first = np.unique(region, return_index=True)[1][-count:] if count else np.empty(0, np.int64)
    places = lattice.points(first)
    exact = igl.fast_winding_number(solid.points, solid.triangles, places)
    winding = np.round(exact).astype(np.int64)
    for place, number in zip(places, winding, strict=True):
        if number not in (0, 1):
            what = "is inside out" if number < 0 else "overlaps another"
            raise StudyError(
                f"stimulus.file: a part of the surface {what} around {shown(place)}; unite its "
                "solids"
            )
    return np.append(False, winding == 1)[region]


def _signed(surface: Triangles, lattice: Lattice, value: Array, near: NDArray[np.bool_]) -> Near:
    """Return the signed distance to a closed surface near it; the rest of `value` stays."""
    flat = np.flatnonzero(near)
    points = lattice.points(flat)
    kind = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    found, _, feet, _ = in_chunks(
        lambda some: igl.signed_distance(some, surface.points, surface.triangles, kind), points
    )
    value.ravel()[flat] = found
    row = np.full(value.size, -1)
    row[flat] = np.arange(len(flat))
    return Near(lattice, value, _unit(points - feet, found), row)


def _near_edges(near: Near) -> NDArray[np.bool_]:
    """Return the points to which an edge of the zero level is nearest, not a face.

    There the way along the gradient does not end on the level.
    """
    lattice, flat = near.lattice, np.flatnonzero(near.row >= 0)
    value, gradient = near.value.ravel()[flat], near.gradient[near.row[flat]]
    places = lattice.points(flat) - value[:, None] * gradient
    known = np.where(near.known, near.value, np.copysign(_UNKNOWN_MM, near.value))
    reached = linear_between(known, lattice.origin, lattice.step, places)
    off_level = np.zeros(near.value.shape, dtype=bool)
    off_level.ravel()[flat] = np.abs(reached) > _EDGE_STEPS * lattice.step
    return ndimage.binary_dilation(off_level) & near.known


def _replaced(near: Near, surface: Triangles, where: NDArray[np.bool_], sign: float) -> Near:
    """Return distances of which some are replaced by those to a surface, with a sign."""
    flat = np.flatnonzero(where)
    if not len(flat):
        return near
    points = near.lattice.points(flat)
    squared, _, feet = in_chunks(
        lambda some: igl.point_mesh_squared_distance(some, surface.points, surface.triangles),
        points,
    )
    found = sign * np.sqrt(squared)
    value, gradient = near.value.copy(), near.gradient.copy()
    value.ravel()[flat] = found
    gradient[near.row[flat]] = _unit(points - feet, found)
    return replace(near, value=value, gradient=gradient)


def _unit(offset: Array, length: Array) -> Array:
    """Return directions (n, 3) of offsets with signed lengths; zero where there is no length."""
    return offset / np.copysign(np.maximum(np.abs(length), 1e-12), length)[:, None]


def _exact_off_edges(rounded: Array, sharp: Array, h: float) -> Array:
    """Return the distance before rounding where rounding changed no more than its own errors."""
    with np.errstate(invalid="ignore"):
        change = np.abs(rounded - sharp) / h
        share = np.clip((change - _NOISE_STEPS) / _NOISE_STEPS, 0.0, 1.0)
        return np.where(share == 1, rounded, sharp + share * (rounded - sharp))


def _continued(
    distance: Array, known: NDArray[np.bool_], inside: NDArray[np.bool_], h: float
) -> Array:
    """Return a distance that grows away from where it is known."""
    away, nearest = ndimage.distance_transform_edt(~known, sampling=h, return_indices=True)
    return distance[tuple(nearest)] + np.where(inside, -away, away)


def too_thin(radius: float) -> StudyError:
    """Return the error of a part that vanishes where its edges are rounded."""
    return StudyError(
        f"stimulus.edge_radius_mm = {radius:g} leaves nothing of the part: it must be less than "
        "half of its thickness"
    )


def shown(place: Array) -> str:
    """Return a place of the part, before its shift, for messages."""
    x, y, z = place
    return f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm of the part in place"
