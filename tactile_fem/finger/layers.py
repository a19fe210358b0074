"""Edge lengths of the elements, rows through the layers of skin, and fingerprints.

A ridge shifts the outer skin and the inner side of the stratum corneum together, so that the layer
keeps its thickness. The crests remain where the smooth skin was; grooves lie deeper by the ridges'
height. The epidermis-dermis interface waves twice as often about its mean depth: an intermediate
ridge lies below each crest, a limiting ridge below each groove, and a papilla of the dermis rises
between them. These shapes are proposed by this project; measures: Corniani et al. (eLife 93554).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import LAYERS, TISSUES
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.shape import Capsule
from tactile_fem.finger.simplex import Indices, Triangles

PATCH_MM = (4.5, 6.0)  # half width (X) and half length (Y) of the finely meshed patch
# Edges of a section relative to those of the solid finger, and their growth per mm from the patch:
# skin is dragged far along a section.
_SECTION_PAD, _SECTION_FAR, _SECTION_GROWTH = 0.25, 0.4, 0.05
_EDGES_PER_RIDGE, _LEAST_EDGES_PER_RIDGE = 8, 4
_BONE_EDGE_PER_GAP = 1.5  # on the palmar side, over the thickness of the subcutaneous tissue
# Rows of a section are at most so many times as high as the edges under the patch are long; in the
# dermis they grow by this share of the depth below its upper limit.
_HEIGHT_PER_EDGE, _DERMIS_GROWTH = 1.3, 0.35
CUT_BLEND_MM = 4.0  # over this length the extrusion turns into the plane of the cut
_FADE_LENGTH_PITCHES = 1.0  # length over which ridges fade out at the end of the ridged skin
_LEAST_EPIDERMIS_SHARE = 0.2  # of the epidermis that remains where ridges or papillae are deepest

Size = Callable[[float, float, float], float]  # of x, y, z on the unbent capsule


@dataclass(frozen=True)
class Sizes:
    """Edge lengths in mm at the contact patch, far from it and on the bone, and their growth.

    At a distance a from the patch the edge length is pad + growth a + curve a^2, at most far.
    """

    pad: float
    far: float
    bone: float
    growth: float
    curve: float
    epidermis_rows: int

    @classmethod
    def of(cls, finger: FingerSettings) -> Sizes:
        """Return the sizes given, else those of the preset; MeshError if they contradict."""
        preset = PRESETS[finger.preset]
        pad = finger.pad_size_mm or preset.pad
        far = finger.far_size_mm or max(preset.far, pad)
        if far < pad:
            raise MeshError(
                f"finger.far_size_mm = {far:g} must not be smaller than the edge under the contact "
                f"patch, {pad:g}"
            )
        bone = far * preset.bone / preset.far
        rows = finger.epidermis_rows or preset.epidermis_rows
        solid = cls(pad, far, bone, preset.growth, preset.curve, rows)
        return solid._of_section(finger) if finger.is_section else solid

    def _of_section(self, finger: FingerSettings) -> Sizes:
        pad, pitch = finger.pad_size_mm or _SECTION_PAD * self.pad, finger.ridge_pitch_mm
        if finger.is_ridged:
            pad = finger.pad_size_mm or min(pad, pitch / _EDGES_PER_RIDGE)
            if pad > pitch / _LEAST_EDGES_PER_RIDGE:
                raise MeshError(
                    f"finger.ridge_pitch_mm = {pitch:g} must be at least {_LEAST_EDGES_PER_RIDGE} "
                    f"times the edge under the contact patch, pad_size_mm = {pad:g}"
                )
        far = finger.far_size_mm or max(_SECTION_FAR * self.far, pad)
        # Its rows are divided by the size of the edges.
        return replace(self, pad=pad, far=far, growth=_SECTION_GROWTH, curve=0.0, epidermis_rows=1)

    def on_skin(self, capsule: Capsule) -> Size:
        """Return the edge length as a function of the position on the unbent capsule."""

        def size(x: float, y: float, z: float) -> float:
            across = max(abs(x) - PATCH_MM[0], 0.0)
            along = max(abs(y) - PATCH_MM[1], 0.0)
            above = max(z + 0.45 * capsule.below, 0.0)
            distance = math.sqrt(across**2 + along**2 + above**2)
            return min(self.pad + distance * (self.growth + self.curve * distance), self.far)

        return size

    def on_bone(self, finger: FingerSettings) -> Size:
        """Return the edge length on the bone; below, it follows the gap to the dermis."""
        near = min(self.bone, max(self.pad, _BONE_EDGE_PER_GAP * finger.subcutaneous_mm))
        return lambda x, y, z: near if z < 0.0 else self.bone


PRESETS = {
    "coarse": Sizes(1.0, 4.5, 3.2, 0.3, 0.3, 2),
    "medium": Sizes(0.56, 2.8, 2.4, 0.3, 0.1, 2),
    "paper": Sizes(0.33, 1.5, 1.4, 0.2, 0.0, 2),
}


@dataclass(frozen=True)
class Layering:
    """Rows of elements through the layers of skin."""

    depths: Array  # (r + 1,) mm, between the rows
    tissue: Indices  # (r,) tag of each row
    nail_rows: int  # the first ones, which belong to the nail under its outline

    def stacked(
        self, cells: Indices, under_nail: NDArray[np.bool_], count: int
    ) -> tuple[Indices, Indices]:
        """Return the cells of all rows, whose nodes are `count` apart, and their tags."""
        rows = range(len(self.tissue))
        nail = [under_nail & (row < self.nail_rows) for row in rows]
        tags = [np.where(nail[row], TISSUES["nail"], self.tissue[row]) for row in rows]
        return np.concatenate([cells + row * count for row in rows]), np.concatenate(tags)

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


def layering(finger: FingerSettings, epidermis_rows: int) -> Layering:
    """Divide the layers into rows; the underside of the nail is one of the boundaries.

    If a boundary within the epidermis is close to the underside of the nail, it is moved there;
    otherwise a row is divided there. Raises MeshError if the layers are thicker than the pad, or
    the nail is thicker than the layers.
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
    names = np.array([TISSUES[name] for name in LAYERS])
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

    The skin has n points and m triangles that face outwards, `directions` (n, 3) are outward ones.
    For r rows return nodes (n (r + 1), 3), node i of depth k at n k + i; tetrahedra (3 m r, 4); and
    their tags (3 m r,).
    """
    count = len(skin.points)
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
    return nodes, *layers.stacked(prism.reshape(-1, 4), np.repeat(under_nail, 3), count)


@dataclass(frozen=True)
class Ridges:
    """How much deeper the layers of a section end, at a length `s` from the contact point, mm.

    Raises MeshError if ridges or papillae are higher than the layers allow.
    """

    finger: FingerSettings

    def __post_init__(self) -> None:
        """Check them against the layers."""
        finger = self.finger
        for name, layer in (
            ("ridge_height_mm", "stratum_corneum_mm"),
            ("papilla_depth_mm", "epidermis_mm"),
        ):
            height, thickness = getattr(finger, name), getattr(finger, layer)
            if height >= thickness:
                raise MeshError(
                    f"finger.{name} = {height:g} must be less than the layer's thickness, "
                    f"{layer} = {thickness:g}"
                )
        rest = finger.epidermis_mm - finger.ridge_height_mm - finger.papilla_depth_mm / 2
        if rest < _LEAST_EPIDERMIS_SHARE * finger.epidermis_mm:
            raise MeshError(
                f"finger.ridge_height_mm = {finger.ridge_height_mm:g} and papilla_depth_mm = "
                f"{finger.papilla_depth_mm:g} leave {rest:.2g} mm of the epidermis' "
                f"{finger.epidermis_mm:g} mm"
            )
        if finger.papilla_depth_mm and finger.papilla_width_mm >= finger.ridge_pitch_mm / 2:
            raise MeshError(
                f"finger.papilla_width_mm = {finger.papilla_width_mm:g} must be less than half of "
                f"ridge_pitch_mm = {finger.ridge_pitch_mm:g}: there are two papillae to a pitch"
            )

    def _fade(self, s: Array) -> Array:
        """Return the share of the full height (n,)."""
        pitches = (self.finger.ridged_half_length_mm - np.abs(s)) / self.finger.ridge_pitch_mm
        t = np.clip(pitches / _FADE_LENGTH_PITCHES, 0.0, 1.0)
        return t * t * (3 - 2 * t)

    def skin(self, s: Array) -> Array:
        """Return how much deeper than the crests the skin lies, (n,) mm."""
        wave = (1 - np.cos(2 * np.pi * s / self.finger.ridge_pitch_mm)) / 2
        return self.finger.ridge_height_mm * self._fade(s) * wave

    def interface(self, s: Array) -> Array:
        """Return how much deeper than its mean the epidermis-dermis interface lies, (n,) mm."""
        # A cosine whose phase is warped, so that a papilla has its width at half its height.
        finger, half = self.finger, self.finger.ridge_pitch_mm / 2
        shift = 0.0 if finger.papillae_aligned else half / 2
        from_papilla = np.abs((s + shift) % half - half / 2)
        power = math.log(0.5) / math.log(finger.papilla_width_mm / half)
        wave = np.cos(np.pi * (from_papilla / (half / 2)) ** power)
        return -finger.papilla_depth_mm / 2 * self._fade(s) * wave
