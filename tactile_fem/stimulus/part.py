"""A rigid part from a file of triangles: put in place, its edges rounded, as a body."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.triangles import Triangles, read_triangles
from tactile_fem.stimulus.body import NEAR_MM, Array
from tactile_fem.stimulus.contour import Lattice
from tactile_fem.stimulus.gridded import RIM, Gridded

try:
    from tactile_fem.stimulus import rounding
except ModuleNotFoundError as error:
    if error.name != "igl":
        raise
    raise TactileError(
        'A stimulus of kind "mesh" needs libigl: pip install "tactile-fem[cad]".'
    ) from None

if TYPE_CHECKING:
    from tactile_fem.stimulus.mesh import Mesh

logger = logging.getLogger(__name__)

# Third, the axis of the file that points up; the two after it in the order x, y, z, x go first.
_CYCLIC = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
_MIN_SIZE_MM, _MAX_SIZE_MM = 1.0, 1000.0
_MAX_POINTS = 5_000_000  # some 200 bytes each while the distance is computed
_FAR_MM = 1e6
# The rounded surface next to a part's own surface turns from it by less: the cosine of 78 degrees.
_MIN_COSINE = 0.2


class Piece(NamedTuple):
    """The part in place, the lattice of its distance, and the corners (3,) of the box to keep."""

    solid: Triangles
    lattice: Lattice
    low: Array
    high: Array


def make_part(stimulus: Mesh) -> Gridded:
    """Return the body of a part, its highest point at z = 0.

    Raises
    ------
    StudyError
        The file is no closed surface, its size or the radius do not fit, or the grid is too large.
    """
    piece = _piece(_placed(_read(stimulus), stimulus), stimulus)
    body, top_mm = _rounded(piece, stimulus)
    _check_nothing_lost(piece, body, stimulus)
    return body.raised(-top_mm)


def _read(stimulus: Mesh) -> Triangles:
    """Return the closed surface of a file, facing outwards, if it has the size of a part."""
    surface = read_triangles(stimulus.file, "stimulus.file", stimulus.unit_mm)
    extent = np.ptp(surface.points, axis=0)
    if not _MIN_SIZE_MM <= extent.max() <= _MAX_SIZE_MM:
        raise StudyError(
            f"stimulus.unit_mm = {stimulus.unit_mm:g} makes the part in {stimulus.file} "
            f"{' x '.join(f'{length:.3g}' for length in extent)} mm large, but its longest side "
            f"must have {_MIN_SIZE_MM:g} to {_MAX_SIZE_MM:g} mm"
        )
    outwards = surface.outwards()
    if outwards is not surface:
        logger.warning("stimulus.file = %s is inside out: its triangles are turned.", stimulus.file)
    _check_closed(outwards, stimulus)
    return outwards


def _check_closed(surface: Triangles, stimulus: Mesh) -> None:
    """Raise StudyError if edges have no neighbour, one that faces the other way, or several."""
    edges = surface.edges()
    pairs, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    number = number.ravel()
    count = np.bincount(number)
    balance = np.bincount(number, weights=np.where(edges[:, 0] < edges[:, 1], 1, -1))
    for wrong, what in (
        (count % 2 == 1, "it is open"),
        (balance != 0, "neighbours face opposite ways"),
        (count > 2, "solids touch"),
    ):
        if wrong.any():
            x, y, z = surface.points[pairs[np.argmax(wrong)]].mean(axis=0)
            raise StudyError(
                f"stimulus.file = {stimulus.file} is no closed surface that faces outwards: {what} "
                f"at {np.count_nonzero(wrong)} edges, the first at {x:.3g}, {y:.3g}, {z:.3g} mm "
                "in the file; repair it"
            )


def _placed(surface: Triangles, stimulus: Mesh) -> Triangles:
    """Return the part turned, its middle over the origin, its highest point at z = 0."""
    points = surface.points[:, _CYCLIC[stimulus.up[1]]]
    if stimulus.up[0] == "-":
        points = points * [1, -1, -1]
    turns = Rotation.from_euler("xyz", [*stimulus.tilt_deg, stimulus.turn_deg], degrees=True)
    points = turns.apply(points)
    low, high = points.min(axis=0), points.max(axis=0)
    origin = [*(low + high)[:2] / 2, high[2]]
    return Triangles(points - origin, surface.triangles)


def _piece(solid: Triangles, stimulus: Mesh) -> Piece:
    """Return where the distance of a part is needed."""
    radius = stimulus.edge_radius_mm
    h = radius / 3 if stimulus.grid_mm is None else stimulus.grid_mm
    if h > radius / 2:
        raise StudyError(
            f"stimulus.grid_mm = {h:g} must not exceed half of edge_radius_mm ({radius / 2:g})"
        )
    margin = max(NEAR_MM + 5 * h, radius + 3 * h)
    solid, window_low, window_high = _in_window(solid, stimulus, margin)
    beyond = 4 * radius + (RIM + 4) * h
    # What lies higher beside the window takes no layers.
    near = _within(solid, window_low - beyond, window_high + beyond)
    low, high = near.min(axis=0) - margin - RIM * h, near.max(axis=0) + margin + RIM * h
    keep = np.maximum(low, window_low - RIM * h), np.minimum(high, window_high + RIM * h)
    low, high = np.maximum(low, window_low - beyond), np.minimum(high, window_high + beyond)
    shape = np.ceil((high - low) / h) + 1
    if math.prod(shape.tolist()) > _MAX_POINTS:
        raise StudyError(
            f"stimulus.grid_mm = {h:.3g} takes {' x '.join(f'{n:.4g}' for n in shape)} points for "
            f"the part, but at most {_MAX_POINTS / 1e6:g} million are allowed: raise it or "
            "edge_radius_mm, or give a smaller window_mm or reach_mm"
        )
    return Piece(solid, Lattice(low, h, tuple(shape.astype(int).tolist())), *keep)


def _in_window(solid: Triangles, stimulus: Mesh, margin: float) -> tuple[Triangles, Array, Array]:
    """Return a part with the highest point of the piece at z = 0, and the corners of its window.

    The window ends `margin` above the piece.
    """
    low, high = np.array([-_FAR_MM, -_FAR_MM, -stimulus.reach_mm]), np.full(3, _FAR_MM)
    high[2] = margin
    if stimulus.window_mm is None:
        return solid, low, high
    half = np.array(stimulus.window_mm) / 2
    low[:2], high[:2] = -half - stimulus.shift_mm, half - stimulus.shift_mm
    piece = _within(solid, low, high)
    if not len(piece):
        ends = np.column_stack([solid.points.min(axis=0), solid.points.max(axis=0)])
        across, along = (f"from {first:.3g} to {last:.3g} mm" for first, last in ends[:2])
        raise StudyError(
            f"stimulus.window_mm = {list(stimulus.window_mm)} holds no piece of the part, which "
            f"lies {across} across and {along} along the finger before shift_mm"
        )
    return Triangles(solid.points - [0, 0, piece[:, 2].max()], solid.triangles), low, high


def _within(solid: Triangles, low: Array, high: Array) -> Array:
    """Return the corners (n, 3) of what of a solid lies between two corners in X and Y."""
    low, high = np.array([*low[:2], -_FAR_MM]), np.array([*high[:2], _FAR_MM])
    return rounding.fine(solid, low, high, np.inf).points


def _rounded(piece: Piece, stimulus: Mesh) -> tuple[Gridded, float]:
    """Return the rounded part and the height of its highest point, mm."""
    lattice, radius = piece.lattice, stimulus.edge_radius_mm
    try:
        values, core = rounding.rounded_distance(
            piece.solid, lattice, radius, NEAR_MM + 5 * lattice.step
        )
        inner = RIM * lattice.step  # beside the window, the part may be higher
        core = core[np.all((core > piece.low + inner) & (core < piece.high - inner), axis=1)]
        if not len(core):
            raise rounding.TooThinError
    except rounding.OverlapError as error:
        what = "is inside out" if error.winding < 0 else "overlaps another"
        raise StudyError(
            f"stimulus.file = {stimulus.file}: a part of the surface {what} around "
            f"{_shown(error.place)}; unite its solids"
        ) from None
    except rounding.TooThinError:
        raise StudyError(
            f"stimulus.edge_radius_mm = {radius:g} leaves nothing of the part: it must be less "
            "than half of its thickness"
        ) from None
    first = np.round((piece.low - lattice.origin) / lattice.step).astype(int)
    last = np.round((piece.high - lattice.origin) / lattice.step).astype(int)
    kept = values[tuple(slice(i, j + 1) for i, j in zip(first, last, strict=True))]
    body = Gridded.of(kept, lattice.origin + first * lattice.step, lattice.step)
    return body, float(core[:, 2].max()) + radius


def _check_nothing_lost(piece: Piece, body: Gridded, stimulus: Mesh) -> None:
    """Raise StudyError if walls or gaps are too thin for the radius.

    The surface of the rounded part next to a wall or gap that vanished lies across it.
    """
    radius = stimulus.edge_radius_mm
    inner = RIM * piece.lattice.step
    fine = rounding.fine(piece.solid, piece.low + inner, piece.high - inner, 2 * piece.lattice.step)
    a, b, c = np.moveaxis(fine.points[fine.triangles], 1, 0)
    across = np.cross(b - a, c - a)
    gap, normal = body.spline.derivatives((a + b + c) / 3, 1)
    lengths = np.linalg.norm(across, axis=1) * np.linalg.norm(normal, axis=1)
    is_turned = np.einsum("ni,ni->n", across, normal) < _MIN_COSINE * lengths
    loss = np.where(is_turned, np.abs(gap), 0.0)
    worst = int(np.argmax(loss))
    if loss[worst] > 0.1 * radius:
        what = "a wall" if gap[worst] > 0 else "a gap"
        raise StudyError(
            f"stimulus.edge_radius_mm = {radius:g} removes {what} of the part at "
            f"{_shown((a + b + c)[worst] / 3)}, which is thinner than twice that: it must be "
            "smaller"
        )


def _shown(place: Array) -> str:
    """Return a place of the part, before its shift, for messages."""
    x, y, z = place
    return f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm of the part in place"
