"""Edge lengths of the elements."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from tactile_fem.errors import MeshError
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import Capsule

PATCH_MM = (4.5, 6.0)  # half width (X) and half length (Y) of the finely meshed patch
# Edges of a section relative to those of the solid finger, and their growth per mm from the patch:
# skin is dragged far along a section.
_SECTION_PAD, _SECTION_FAR, _SECTION_GROWTH = 0.25, 0.4, 0.05
_EDGES_PER_RIDGE, _LEAST_EDGES_PER_RIDGE = 8, 4
_BONE_EDGE_PER_GAP = 1.5  # on the palmar side, over the thickness of the subcutaneous tissue

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
    def of(cls, finger: Finger) -> Sizes:
        """Return the preset's sizes, overridden by the finger's own values.

        Raises
        ------
        MeshError
            They contradict each other, or are too long for the ridges.
        """
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

    def _of_section(self, finger: Finger) -> Sizes:
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

    def on_bone(self, finger: Finger) -> Size:
        """Return the bone's edge length; on its palmar side it follows the gap to the dermis."""
        near = min(self.bone, max(self.pad, _BONE_EDGE_PER_GAP * finger.subcutaneous_mm))
        return lambda x, y, z: near if z < 0.0 else self.bone


PRESETS = {
    "coarse": Sizes(1.0, 4.5, 3.2, 0.3, 0.3, 2),
    "medium": Sizes(0.56, 2.8, 2.4, 0.3, 0.1, 2),
    "paper": Sizes(0.33, 1.5, 1.4, 0.2, 0.0, 2),
}
