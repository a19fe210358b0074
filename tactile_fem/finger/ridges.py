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
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import Finger

_FADE_PITCHES = 1.0  # length over which ridges fade out at the end of the ridged skin
_LEAST_SHARE = 0.2  # of the epidermis that remains where ridges or papillae are deepest


@dataclass(frozen=True)
class Ridges:
    """How much deeper a section's layers end, over the length `s` from the contact point in mm.

    Raises MeshError if ridges or papillae are higher than the layers allow.
    """

    finger: Finger

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
        if rest < _LEAST_SHARE * finger.epidermis_mm:
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
        t = np.clip(pitches / _FADE_PITCHES, 0.0, 1.0)
        return t * t * (3 - 2 * t)

    def skin(self, s: Array) -> Array:
        """Return how much deeper than the crests the skin lies, (n,) mm."""
        wave = (1 - np.cos(2 * np.pi * s / self.finger.ridge_pitch_mm)) / 2
        return self.finger.ridge_height_mm * self._fade(s) * wave

    def interface(self, s: Array) -> Array:
        """Return how much deeper than its mean the epidermis-dermis interface lies, (n,) mm.

        A cosine whose phase is warped, so that a papilla has its width at half its height.
        """
        finger, half = self.finger, self.finger.ridge_pitch_mm / 2
        shift = 0.0 if finger.papillae_aligned else half / 2
        from_papilla = np.abs((s + shift) % half - half / 2)
        power = math.log(0.5) / math.log(finger.papilla_width_mm / half)
        wave = np.cos(np.pi * (from_papilla / (half / 2)) ** power)
        return -finger.papilla_depth_mm / 2 * self._fade(s) * wave
