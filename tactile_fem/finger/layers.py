"""The layers of the skin: rows of elements between the outer skin and the subcutaneous tissue."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.simplex import Indices
from tactile_fem.runtime.triangles import Triangles

CUT_BLEND_MM = 4.0  # over this length the extrusion turns into the plane of the cut
# Rows of a section are at most so many times as high as the edges under the patch are long; in the
# dermis they grow by this share of the depth below its upper limit.
_HEIGHT_PER_EDGE, _DERMIS_GROWTH = 1.3, 0.35


@dataclass(frozen=True)
class Layering:
    """Depths (r + 1,) in mm that bound the rows, and the tissue tag (r,) of each row.

    Under the nail's outline the first `nail_rows` rows belong to the nail.
    """

    depths: Array
    tissue: Indices
    nail_rows: int

    def tissue_of(self, row: int, under_nail: NDArray[np.bool_]) -> Indices:
        """Return the tags of a row's parts, of which some lie under the nail."""
        nail = under_nail & (row < self.nail_rows)
        return np.where(nail, TISSUES["nail"], self.tissue[row])

    def divided(self, edge_mm: float) -> Layering:
        """Return the layering with rows divided that are too high for edges of this length."""
        depths, tissue, nail_rows = [0.0], [], 0
        dermis = self.depths[np.argmax(self.tissue == TISSUES["dermis"])]
        for k, (top, bottom) in enumerate(pairwise(self.depths)):
            rows = (bottom - top) / (_HEIGHT_PER_EDGE * edge_mm)
            if top < dermis:
                share = np.linspace(0, 1, math.ceil(rows) + 1)
            else:  # rows that grow with the depth are of one height on the scale of its logarithm
                end = math.log1p(_DERMIS_GROWTH * rows)
                share = np.linspace(0, 1, math.ceil(end / _DERMIS_GROWTH) + 1)
                share = np.expm1(share * end) / math.expm1(end)
            depths += (top + share[1:] * (bottom - top)).tolist()
            tissue += [self.tissue[k]] * (len(share) - 1)
            nail_rows += (len(share) - 1) * (k < self.nail_rows)
        return Layering(np.array(depths), np.array(tissue), nail_rows)


def layering(finger: Finger, epidermis_rows: int) -> Layering:
    """Divide the layers into rows; the underside of the nail is one of the boundaries.

    If a boundary within the epidermis is close to the underside of the nail, it is moved there;
    otherwise a row is divided there.

    Raises
    ------
    MeshError
        The layers are thicker than the pad, or the nail is thicker than the layers.
    """
    corneum, bottom = finger.stratum_corneum_mm, finger.skin_thickness_mm
    dermis_top, nail = corneum + finger.epidermis_mm, finger.nail_thickness_mm
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
    skin: Triangles, directions: Array, under_nail: NDArray[np.bool_], layers: Layering
) -> tuple[Array, Indices, Indices]:
    """Extrude the skin inwards; each prism of a row becomes three tetrahedra.

    Parameters
    ----------
    skin
        n points of the outer skin in mm, m triangles that face outwards.
    directions, under_nail
        (n, 3) outward directions; (m,) whether a triangle is under the nail.
    layers
        The r rows.

    Returns
    -------
    nodes, tets, tissue
        (n (r + 1), 3), node i of depth k at n k + i; (3 m r, 4); (3 m r,) tags.
    """
    count, rows = len(skin.points), range(len(layers.tissue))
    nodes = np.vstack([skin.points - depth * directions for depth in layers.depths])
    # Sorted corners give the two prisms at a common side the same diagonal.
    order = np.argsort(skin.triangles, axis=1)
    i, j, k = np.take_along_axis(skin.triangles, order, axis=1).T
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
    tets = np.concatenate([prism.reshape(-1, 4) + row * count for row in rows])
    tissue = np.concatenate([np.repeat(layers.tissue_of(row, under_nail), 3) for row in rows])
    return nodes, tets, tissue
