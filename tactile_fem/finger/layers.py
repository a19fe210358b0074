"""Layers of skin: its triangles are extruded inwards to prisms of three tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.finger.shape import Array
from tactile_fem.study import Finger

CUT_BLEND_MM = 4.0  # over this length the extrusion turns into the plane of the cut


@dataclass(frozen=True)
class Layering:
    """Depths (r + 1,) in mm that bound the rows, and the tissue tag (r,) of each row.

    Under the nail's outline the first `nail_rows` rows belong to the nail.
    """

    depths: Array
    tissue: NDArray[np.int64]
    nail_rows: int


def layering(finger: Finger, epidermis_rows: int) -> Layering:
    """Divide the layers into rows; the underside of the nail is one of the boundaries.

    If a boundary within the epidermis is close to the underside of the nail, it is moved there;
    otherwise a row is divided there.

    Raises
    ------
    MeshError
        The layers are thicker than the pad, or the nail is thicker than the layers.
    """
    corneum = finger.stratum_corneum_mm
    dermis_top = corneum + finger.epidermis_mm
    bottom = dermis_top + finger.dermis_mm
    nail = finger.nail_thickness_mm
    if nail >= bottom - 0.05:
        raise MeshError(
            f"finger.nail_thickness_mm = {nail:g} must be less than the layers of skin, "
            f"{bottom:g} mm"
        )
    if bottom >= 0.5 * min(finger.half_width_mm, finger.dorsal_height_mm):
        raise MeshError(
            f"the layers of skin ({bottom:g} mm) are too thick for a finger of half width "
            f"{finger.half_width_mm:g} mm and dorsal height {finger.dorsal_height_mm:g} mm"
        )
    depths = [0.0, *np.linspace(corneum, dermis_top, epidermis_rows + 1), bottom]
    fixed = {0.0, corneum, dermis_top, bottom}
    near = min(depths[1:-1], key=lambda depth: abs(depth - nail))
    row = finger.epidermis_mm / epidermis_rows
    if abs(near - nail) > 1e-6:
        if near not in fixed and abs(near - nail) < 0.4 * row:
            depths.remove(near)
        depths.append(nail)
    limits = np.array(sorted(depths))
    middle = 0.5 * (limits[1:] + limits[:-1])
    names = np.array([TISSUES[name] for name in ("stratum_corneum", "epidermis", "dermis")])
    tissue = names[np.searchsorted([corneum, dermis_top], middle)]
    return Layering(limits, tissue, int(np.searchsorted(limits, nail - 1e-6)))


def extrusion_directions(points: Array, normals: Array, cut_y: float) -> Array:
    """Return directions (n, 3) with unit normal component, in the cut plane at the cut."""
    t = np.clip((points[:, 1] - cut_y) / CUT_BLEND_MM, 0.0, 1.0)
    directions = normals.copy()
    directions[:, 1] *= t * t * (3.0 - 2.0 * t)
    return directions / np.einsum("ij,ij->i", directions, normals)[:, None]


def extrude(
    points: Array,
    directions: Array,
    triangles: NDArray[np.int64],
    under_nail: NDArray[np.bool_],
    layers: Layering,
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Extrude the skin inwards.

    Parameters
    ----------
    points, directions
        (n, 3) points of the outer skin in mm, and outward directions.
    triangles, under_nail
        (m, 3) corners, oriented outwards; (m,) whether a triangle is under the nail.
    layers
        The rows.

    Returns
    -------
    nodes, tets, tissue
        (n (r + 1), 3), node i of depth k at n k + i; (3 m r, 4); (3 m r,) tags.
    """
    count, rows = len(points), len(layers.tissue)
    nodes = np.vstack([points - depth * directions for depth in layers.depths])
    # Sorted corners give the two prisms at a common side the same diagonal.
    order = np.argsort(triangles, axis=1)
    i, j, k = np.take_along_axis(triangles, order, axis=1).T
    prism = np.stack(
        [
            np.column_stack([i, j, k, k + count]),
            np.column_stack([j, i, j + count, k + count]),
            np.column_stack([i, i + count, j + count, k + count]),
        ],
        axis=1,
    )
    odd = (order[:, 0] > order[:, 1]) ^ (order[:, 1] > order[:, 2]) ^ (order[:, 0] > order[:, 2])
    # (i, j, k) is oriented outwards and the fourth corner is inside, so even ones are inverted.
    prism[~odd] = prism[~odd][..., [1, 0, 2, 3]]
    tets = np.concatenate([prism.reshape(-1, 4) + row * count for row in range(rows)])
    tissue = np.empty((rows, len(triangles), 3), dtype=np.int64)
    for row in range(rows):
        nail = under_nail & (row < layers.nail_rows)
        tissue[row] = np.where(nail, TISSUES["nail"], layers.tissue[row])[:, None]
    return nodes, tets, tissue.reshape(-1)
