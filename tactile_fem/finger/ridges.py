"""Fingerprints: ridges of the skin, and intermediate ridges and papillae below the epidermis.

Outer skin and inner side of the stratum corneum are shifted together, so that the layer keeps its
thickness. The crests stay where the smooth skin was; grooves lie deeper by the ridges' height. The
epidermis-dermis interface waves twice as often about its mean depth: an intermediate ridge lies
below each crest, a limiting ridge below each groove, and a papilla of the dermis rises between
them. These shapes are proposed by this project; measures: Corniani et al. (eLife 93554).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.shape import Array

# Over so many pitches ridges fade out at the end of the ridged skin.
_FADES = 1.0
# Of a layer must be left where ridges or papillae are deepest.
_LEAST_SHARE = 0.2


@dataclass(frozen=True)
class Ridges:
    """Shift of the layers' limits over the length of the skin from the contact point.

    Attributes
    ----------
    pitch, height, papilla_depth, papilla_width, half_length
        In mm.
    aligned
        Whether an intermediate ridge lies below each crest.
    """

    pitch: float
    height: float
    papilla_depth: float
    papilla_width: float
    half_length: float
    aligned: bool

    @classmethod
    def of(cls, finger: Finger) -> Ridges:
        """Return the ridges of a study.

        Raises
        ------
        MeshError
            They are higher than the layers allow.
        """
        layers = {
            "ridge_height_mm": ("stratum_corneum_mm", finger.stratum_corneum_mm),
            "papilla_depth_mm": ("epidermis_mm", finger.epidermis_mm),
        }
        for name, (layer, thickness) in layers.items():
            if getattr(finger, name) >= thickness:
                raise MeshError(
                    f"finger.{name} = {getattr(finger, name):g} must be less than the layer's "
                    f"thickness, {layer} = {thickness:g}"
                )
        left = finger.epidermis_mm - finger.ridge_height_mm - finger.papilla_depth_mm / 2
        if left < _LEAST_SHARE * finger.epidermis_mm:
            raise MeshError(
                f"finger.ridge_height_mm = {finger.ridge_height_mm:g} and papilla_depth_mm = "
                f"{finger.papilla_depth_mm:g} leave {left:.2g} mm of the epidermis' "
                f"{finger.epidermis_mm:g} mm"
            )
        if finger.papilla_depth_mm and finger.papilla_width_mm >= finger.ridge_pitch_mm / 2:
            raise MeshError(
                f"finger.papilla_width_mm = {finger.papilla_width_mm:g} must be less than half of "
                f"ridge_pitch_mm = {finger.ridge_pitch_mm:g}: there are two papillae to a pitch"
            )
        return cls(
            finger.ridge_pitch_mm,
            finger.ridge_height_mm,
            finger.papilla_depth_mm,
            finger.papilla_width_mm,
            finger.ridged_half_length_mm,
            finger.papillae_aligned,
        )

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return self.height > 0 or self.papilla_depth > 0

    def reach(self, s: Array) -> Array:
        """Return the share of the full height (n,) at lengths `s` (n,) from the contact point."""
        t = np.clip((self.half_length - np.abs(s)) / (_FADES * self.pitch), 0.0, 1.0)
        return t * t * (3 - 2 * t)

    def skin(self, s: Array) -> Array:
        """Return how much deeper than the crests the skin lies, (n,) mm."""
        return self.height * self.reach(s) * (1 - np.cos(2 * np.pi * s / self.pitch)) / 2

    def interface(self, s: Array) -> Array:
        """Return how much deeper than its mean the epidermis-dermis interface lies, (n,) mm.

        A cosine whose phase is warped, so that a papilla is `papilla_width` wide at half its
        height.
        """
        quarter = self.pitch / 4
        shift = 0.0 if self.aligned else quarter
        # Distance from the nearest papilla's middle; those lie half a pitch apart.
        t = np.abs((s + shift) % (2 * quarter) - quarter)
        power = math.log(0.5) / math.log(self.papilla_width / (2 * quarter))
        wave = np.cos(np.pi * (t / quarter) ** power)
        return -self.papilla_depth / 2 * self.reach(s) * wave
