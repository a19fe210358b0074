"""The bone on its joint: its angle, and the body as seen from it.

The mechanics is computed in the bone's frame, in which the held tissues are at rest: the body moves
by the inverse of the bone's motion. The angle `phi` balances the moment `M` of the tissue,

    I phi'' + c phi' + k phi = M.

Where the tissue has mass, `M` is that of the contact less its rate of angular momentum, and `I` is
what it leaves of the phalanx's moment of inertia.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_fem.finger.joint import Joint
from tactile_fem.mechanics.terms.inertia import GeneralizedAlpha
from tactile_fem.path.rotations import matrix, moment_about
from tactile_fem.simulation.pose import Pose, turned_with_bone

Array = np.ndarray
_METHOD = GeneralizedAlpha()


@dataclass(frozen=True)
class Bone:
    """The bone after an accepted step.

    Parameters
    ----------
    joint
        Its joint.
    inertia_Nmms2
        Moment of inertia without the tissue; None if nothing has mass.
    angle_rad, rate_rad_s, rate_rad_s2
        Angle about the joint and its derivatives.
    before_rad
        Angle at the accepted step before.
    """

    joint: Joint
    inertia_Nmms2: float | None = None
    angle_rad: float = 0.0
    rate_rad_s: float = 0.0
    rate_rad_s2: float = 0.0
    before_rad: float = 0.0

    def to_save(self) -> dict[str, float]:
        """Return its motion as plain numbers, by name."""
        names = "angle_rad", "rate_rad_s", "rate_rad_s2", "before_rad"
        return {name: getattr(self, name) for name in names}

    def seen_from(self, pose: Pose, angle_rad: float) -> Pose:
        """Return a pose in space as seen from the bone at an angle."""
        return turned_with_bone(pose, self.joint, -angle_rad)

    def in_space(self, pose: Pose, angle_rad: float) -> Pose:
        """Return where a pose seen from the bone at an angle is in space."""
        return turned_with_bone(pose, self.joint, angle_rad)

    def places_in_space(self, places_mm: Array) -> Array:
        """Return where places (n, 3) seen from the bone are in space."""
        R, centre = matrix([self.angle_rad, 0.0, 0.0]), self.joint.centre_mm
        return centre + (places_mm - centre) @ R.T

    def load_in_space(
        self, force_N: Array, moment_Nmm: Array, angle_rad: float
    ) -> tuple[Array, Array]:
        """Return force and moment about the origin in space, (3,), of those seen from the bone."""
        R, centre = matrix([angle_rad, 0.0, 0.0]), self.joint.centre_mm
        force = R @ force_N
        moment = R @ moment_about(centre, force_N, moment_Nmm) + np.cross(centre, force)
        return force, moment

    def swing(self, angle_rad: float) -> Array:
        """Return how it has swung to an angle, as in `State.swing`, (3, 4)."""
        still = Pose(np.zeros(3), np.eye(3))
        moved = turned_with_bone(still, self.joint, angle_rad - self.angle_rad)
        return np.column_stack([moved.rotation - np.eye(3), moved.translation])

    def moved(self, angle_rad: float, dt_s: float) -> Bone:
        """Return the bone at an angle, `dt_s` later."""
        moved_rad = angle_rad - self.angle_rad
        velocity, acceleration = moved_rad / dt_s, 0.0
        if self.inertia_Nmms2 is not None:
            old = self.rate_rad_s, self.rate_rad_s2
            acceleration = _METHOD.acceleration(moved_rad, *old, dt_s)
            velocity = _METHOD.velocity(acceleration, *old, dt_s)
        return replace(
            self,
            angle_rad=angle_rad,
            rate_rad_s=velocity,
            rate_rad_s2=acceleration,
            before_rad=self.angle_rad,
        )

    def moments_N(self, angle_rad: float, dt_s: float, force_N: Array, moment_Nmm: Array) -> Array:
        """Return the moments about the joint, whose sum is to vanish, over its distance, N, (4,).

        Those of the tissue, the joint's stiffness, its damping and the bone's mass.

        Parameters
        ----------
        angle_rad
            Angle of the bone `dt_s` after the last accepted step.
        force_N, moment_Nmm
            Load of the tissue, (3,), as seen from the bone; the moment is about the origin.
        """
        joint, now = self.joint, self.moved(angle_rad, dt_s)
        moment = moment_about(joint.centre_mm, force_N, moment_Nmm)[0]
        stiffness = -joint.stiffness_Nmm_rad * angle_rad
        damping = -joint.damping_Nmms_rad * now.rate_rad_s
        averaged = _METHOD.averaged(now.rate_rad_s2, self.rate_rad_s2)
        mass = -(self.inertia_Nmms2 or 0.0) * averaged
        return np.array([moment, stiffness, damping, mass]) / joint.length_mm
