"""The last joint of the finger: a hinge about which the bone turns."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from tactile_fem.runtime.settings import Finite, NonNegative, Positive, Settings

Array = np.ndarray
_NMM_S2_PER_G_MM2 = 1e-6
_AXIS = np.array([1.0, 0.0, 0.0])


class Joint(Settings):
    """Hinge at the last joint, about X: all fixed parts turn about it as one rigid bone.

    Without this table the bone is clamped. A force on the pad that pushes towards the nail, or
    along the finger, turns the bone.
    """

    stiffness_Nmm_rad: Positive = Field(
        120.0, description="proposed: moment of the joint per angle; 0.19 N/mm at the pad"
    )
    damping_Nmms_rad: NonNegative = Field(
        0.9, description="proposed: moment of the joint per angular velocity"
    )
    mass_g: NonNegative = Field(
        3.0,
        description="proposed: of the phalanx with its soft tissue, as a rod of length_mm; the "
        "moment of inertia of the meshed tissue is subtracted",
    )
    length_mm: Positive = Field(
        25.0, description="proposed: from the contact point to the joint, towards the palm"
    )
    height_mm: Finite = Field(
        7.6, description="height over the contact point; by default the axis of the default bone"
    )

    @property
    def centre_mm(self) -> Array:
        """A point of the axis, (3,)."""
        return np.array([0.0, -self.length_mm, self.height_mm])

    @property
    def inertia_Nmms2(self) -> float:
        """Moment of inertia of the phalanx, N mm s2."""
        return self.mass_g * self.length_mm**2 / 3 * _NMM_S2_PER_G_MM2

    def inertia_beyond(self, tissue_Nmms2: float) -> float:
        """Return the moment of inertia that the meshed tissue leaves to the bone, N mm s2."""
        return max(self.inertia_Nmms2 - tissue_Nmms2, 0.0)

    def arms(self, places_mm: Array) -> Array:
        """Return how places move per angle of the bone, mm/rad, (n, 3).

        Their product with forces is the moment about the joint.
        """
        return np.cross(_AXIS, np.asarray(places_mm) - self.centre_mm)

    def inwards(self, places_mm: Array) -> Array:
        """Return how the arms of places change per angle of the bone, mm/rad^2, (n, 3)."""
        return np.cross(_AXIS, self.arms(places_mm))

    def moment_per_angle(self, frequency_Hz: float) -> complex:
        """Return the moment in Nmm that turns the joint alone by 1 rad at a frequency."""
        return complex(self.stiffness_Nmm_rad, 2 * math.pi * frequency_Hz * self.damping_Nmms_rad)
