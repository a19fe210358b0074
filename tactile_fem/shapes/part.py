"""A rigid part from a file of triangles: put in place, its edges rounded, as a body."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_fem.errors import StudyError, TactileError
from tactile_fem.shapes.contour import Lattice
from tactile_fem.shapes.surface_files import Array, Triangles, read_triangles
from tactile_fem.stimulus import NEAR_MM, Distance, GridSpline, linear_between

try:
    from tactile_fem.shapes import rounding
except ModuleNotFoundError as error:
    if error.name != "igl":
        raise
    raise TactileError(
        'A stimulus of kind "mesh" needs libigl: pip install "tactile-fem[cad]".'
    ) from None

logger = logging.getLogger(__name__)

# Third, the axis of the file that points up; the two after it in the order x, y, z, x go first.
_CYCLIC = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
_MIN_SIZE_MM, _MAX_SIZE_MM = 1.0, 1000.0
_MAX_POINTS = 5_000_000  # some 200 bytes each while the distance is computed
_FAR_MM = 1e6
# Points at each end of the grid that serve the spline only: it is mirrored beyond them.
_RIM = 4
# The rounded surface next to a part's own surface turns from it by less: the cosine of 78 degrees.
_MIN_COSINE = 0.2


@dataclass(frozen=True)
class Gridded:
    """A body by its signed distance in mm on a grid (X, Y, Z), and the cubic spline through it."""

    values: Array
    spline: GridSpline

    def raised(self, by: float) -> Gridded:
        """Return the body moved up by some mm."""
        origin = self.spline.origin + np.array([0.0, 0.0, by])
        return replace(self, spline=replace(self.spline, origin=origin))

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3).

        More than 0.5 mm above the surface it is linear between the grid's values, and the gradient
        points up. Beyond the grid it is continued: there as a constant, nearer in straight lines.
        """
        origin, step = self.spline.origin, self.spline.spacing
        first, last = np.full(3, _RIM), np.array(self.values.shape) - 1 - _RIM
        inside = np.clip(points, origin + step * first, origin + step * last)
        gap = linear_between(self.values, origin, step, inside)
        normal, hessian = np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros((len(points), 3, 3))
        near = np.flatnonzero(gap < NEAR_MM)
        value, slope, bend = self.spline.derivatives(inside[near], 2)
        beyond = (points - inside)[near]
        for axis in range(3):
            bend[beyond[:, axis] != 0, axis] = 0.0
            bend[beyond[:, axis] != 0, :, axis] = 0.0
        gap[near] = value + np.einsum("ni,ni->n", slope, beyond)
        normal[near], hessian[near] = slope, bend
        return Distance(gap, normal, hessian)


class Piece(NamedTuple):
    """The part in place, the lattice of its distance, and the corners (3,) of the box to keep."""

    solid: Triangles
    lattice: Lattice
    low: Array
    high: Array


def read_solid(file: Path, unit_mm: float) -> Triangles:
    """Return the closed surface of a file, facing outwards.

    Raises
    ------
    StudyError
        It cannot be read, is not closed, or has not the size of a part.
    """
    surface = read_triangles(file, "stimulus.file", unit_mm)
    extent = np.ptp(surface.points, axis=0)
    if not _MIN_SIZE_MM <= extent.max() <= _MAX_SIZE_MM:
        raise StudyError(
            f"stimulus.unit_mm = {unit_mm:g} makes the part in {file} "
            f"{' x '.join(f'{length:.3g}' for length in extent)} mm large, but its longest side "
            f"must have {_MIN_SIZE_MM:g} to {_MAX_SIZE_MM:g} mm"
        )
    outwards = surface.outwards()
    if outwards is not surface:
        logger.warning("stimulus.file = %s is inside out: its triangles are turned.", file)
    _check_closed(outwards, file)
    return outwards


def _check_closed(surface: Triangles, file: Path) -> None:
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
                f"stimulus.file = {file} is no closed surface that faces outwards: {what} "
                f"at {np.count_nonzero(wrong)} edges, the first at {x:.3g}, {y:.3g}, {z:.3g} mm "
                "in the file; repair it"
            )


def placed(solid: Triangles, up: str, tilt_deg: tuple[float, float], turn_deg: float) -> Triangles:
    """Return the part turned, its middle over the origin, its highest point at z = 0."""
    points = solid.points[:, _CYCLIC[up[1]]]
    if up[0] == "-":
        points = points * [1, -1, -1]
    points = Rotation.from_euler("xyz", [*tilt_deg, turn_deg], degrees=True).apply(points)
    low, high = points.min(axis=0), points.max(axis=0)
    return Triangles(points - [*(low + high)[:2] / 2, high[2]], solid.triangles)


def piece_of(
    solid: Triangles,
    *,
    radius: float,
    step: float | None,
    reach: float,
    window: tuple[float, float] | None,
    shift: tuple[float, float],
) -> Piece:
    """Return the piece of a part in place that is modelled, its highest point at z = 0; mm.

    It reaches so far down from its highest point, with width and length `window` about the origin
    of the body moved by `shift`; by default it is the whole part. The lattice's step is a third of
    the edges' radius by default.

    Raises
    ------
    StudyError
        The step is too large for the radius or too small for the part, or the window is empty.
    """
    h = radius / 3 if step is None else step
    if h > radius / 2:
        raise StudyError(
            f"stimulus.grid_mm = {h:g} must not exceed half of edge_radius_mm ({radius / 2:g})"
        )
    margin = max(NEAR_MM + 5 * h, radius + 3 * h)
    window_low, window_high = np.array([-_FAR_MM, -_FAR_MM, -reach]), np.full(3, _FAR_MM)
    window_high[2] = margin
    if window is not None:
        half = np.array(window) / 2
        window_low[:2], window_high[:2] = -half - shift, half - shift
        solid = solid.moved(np.array([0, 0, -_top(solid, window, window_low, window_high)]))
    beyond = 4 * radius + (_RIM + 4) * h
    # What lies higher beside the window takes no layers.
    near = _within(solid, window_low - beyond, window_high + beyond)
    low, high = near.min(axis=0) - margin - _RIM * h, near.max(axis=0) + margin + _RIM * h
    keep = np.maximum(low, window_low - _RIM * h), np.minimum(high, window_high + _RIM * h)
    low, high = np.maximum(low, window_low - beyond), np.minimum(high, window_high + beyond)
    shape = np.ceil((high - low) / h) + 1
    if math.prod(shape.tolist()) > _MAX_POINTS:
        raise StudyError(
            f"stimulus.grid_mm = {h:.3g} takes {' x '.join(f'{n:.4g}' for n in shape)} points for "
            f"the part, but at most {_MAX_POINTS / 1e6:g} million are allowed: raise it or "
            "edge_radius_mm, or give a smaller window_mm or reach_mm"
        )
    return Piece(solid, Lattice(low, h, tuple(shape.astype(int).tolist())), *keep)


def _top(solid: Triangles, window: tuple[float, float], low: Array, high: Array) -> float:
    """Return the height of a part's highest point in a window; raise StudyError if it is empty."""
    inside = _within(solid, low, high)
    if not len(inside):
        ends = np.column_stack([solid.points.min(axis=0), solid.points.max(axis=0)])
        across, along = (f"from {first:.3g} to {last:.3g} mm" for first, last in ends[:2])
        raise StudyError(
            f"stimulus.window_mm = {list(window)} holds no piece of the part, which "
            f"lies {across} across and {along} along the finger before shift_mm"
        )
    return float(inside[:, 2].max())


def _within(solid: Triangles, low: Array, high: Array) -> Array:
    """Return the corners (n, 3) of what of a solid lies between two corners in X and Y."""
    low, high = np.array([*low[:2], -_FAR_MM]), np.array([*high[:2], _FAR_MM])
    return rounding.fine(solid, low, high, np.inf).points


def rounded(piece: Piece, radius: float) -> Gridded:
    """Return the body of a piece whose edges are rounded, its highest point at z = 0.

    Raises
    ------
    StudyError
        Surfaces of the part overlap, or it is too thin for the radius.
    """
    lattice = piece.lattice
    reach, inner = NEAR_MM + 5 * lattice.step, _RIM * lattice.step
    values, core = rounding.rounded_distance(piece.solid, lattice, radius, reach)
    # Beside the window, the part may be higher.
    core = core[np.all((core > piece.low + inner) & (core < piece.high - inner), axis=1)]
    if not len(core):
        raise rounding.too_thin(radius)
    first = np.round((piece.low - lattice.origin) / lattice.step).astype(int)
    last = np.round((piece.high - lattice.origin) / lattice.step).astype(int)
    kept = values[tuple(slice(i, j + 1) for i, j in zip(first, last, strict=True))]
    origin = lattice.origin + first * lattice.step
    body = Gridded(kept, GridSpline.through(kept, origin, (lattice.step,) * 3))
    _check_nothing_lost(piece, body, radius)
    return body.raised(-(float(core[:, 2].max()) + radius))


def _check_nothing_lost(piece: Piece, body: Gridded, radius: float) -> None:
    """Raise StudyError if walls or gaps are too thin for the radius.

    The surface of the rounded part next to a wall or gap that vanished lies across it.
    """
    inner = _RIM * piece.lattice.step
    fine = rounding.fine(piece.solid, piece.low + inner, piece.high - inner, 2 * piece.lattice.step)
    centres, across = fine.corners.mean(axis=1), fine.area_vectors
    gap, normal = body.spline.derivatives(centres, 1)
    lengths = np.linalg.norm(across, axis=1) * np.linalg.norm(normal, axis=1)
    is_turned = np.einsum("ni,ni->n", across, normal) < _MIN_COSINE * lengths
    loss = np.where(is_turned, np.abs(gap), 0.0)
    worst = int(np.argmax(loss))
    if loss[worst] > 0.1 * radius:
        what = "a wall" if gap[worst] > 0 else "a gap"
        raise StudyError(
            f"stimulus.edge_radius_mm = {radius:g} removes {what} of the part at "
            f"{rounding.shown(centres[worst])}, which is thinner than twice that: it must be "
            "smaller"
        )
