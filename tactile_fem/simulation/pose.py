"""A place of the body: position and rotation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.finger.joint import Joint
from tactile_fem.path.rotations import matrix, moment_about

Array = np.ndarray


@dataclass(frozen=True)
class Pose:
    """A place of the body: position (3,) of its origin, mm, and rotation (3, 3)."""

    translation: Array
    rotation: Array

    def is_near(self, other: Pose) -> bool:
        """Return whether it is another one but for rounding."""
        pairs = (self.translation, other.translation), (self.rotation, other.rotation)
        return all(np.allclose(a, b, rtol=0.0, atol=1e-9) for a, b in pairs)

    def load(self, force_N: Array, moment_Nmm: Array) -> Array:
        """Return forces, N, and the torque about Z through the body's origin, Nmm, (4,).

        `moment_Nmm` (3,) is that of the force (3,) about the origin.
        """
        return np.append(force_N, moment_about(self.translation, force_N, moment_Nmm)[2])


def turned_with_bone(pose: Pose, joint: Joint, angle_rad: float) -> Pose:
    """Return a pose that turns about a joint by an angle as the bone does."""
    R, centre = matrix([angle_rad, 0.0, 0.0]), joint.centre_mm
    return Pose(centre + R @ (pose.translation - centre), R @ pose.rotation)
