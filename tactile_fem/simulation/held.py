"""Where a step moves the body to: along the path, and as the loads that it holds need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.path.loads import COMPONENTS
from tactile_fem.path.rotations import ARM_MM, matrix, vector
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.pose import Pose

Array = np.ndarray
_TORQUE, JOINT = 3, 4
# From torque, Nmm, to N, and from mm to an angle, rad.
SCALES = np.array([1.0, 1.0, 1.0, 1 / ARM_MM])
_NONE = np.zeros(0)


@dataclass(frozen=True)
class Held:
    """The loads that a step holds, and the joint that is in balance.

    Unknown are the places of the body along the held components, in mm: those of the path's `pose`
    do not count, but for a turn about Z, which is added to the path's. The last one, if the bone is
    on its joint, is how far the contact point moves against Z with the bone.

    Parameters
    ----------
    components
        Indices of `COMPONENTS`.
    loads
        Wanted, of all components, (4,).
    pose
        By the path at the end of the step.
    bone
        After the last accepted step; None if it is clamped.
    dt_s
        Duration of the step.
    """

    components: tuple[int, ...]
    loads: Array
    pose: Pose
    bone: Bone | None
    dt_s: float

    @property
    def indices(self) -> list[int]:
        """Indices of the unknowns and of their loads among all, (k,)."""
        return [*self.components, *([JOINT] if self.bone else [])]

    def angle_rad(self, x: Array) -> float:
        """Return the angle of the bone for the unknowns, (k,)."""
        return -float(x[-1]) / self.bone.joint.length_mm if self.bone else 0.0

    def pose_at(self, x: Array) -> Pose:
        """Return the pose of the body in space for the unknowns, (k,)."""
        place, turn = self.pose.translation.copy(), np.zeros(3)
        for component, value in zip(self.components, x, strict=False):
            if component == _TORQUE:
                turn[2] = value / ARM_MM
            else:
                place[component] = value
        return Pose(place, matrix(turn) @ self.pose.rotation)

    def unknowns(self, pose: Pose, path: Pose, angle_rad: float) -> Array:
        """Return the unknowns, (k,), of a pose where the path is at another one."""
        turn = vector(pose.rotation @ path.rotation.T)[2] * ARM_MM
        down = -angle_rad * self.bone.joint.length_mm if self.bone else 0.0
        return np.array([*pose.translation, turn, down])[self.indices]

    def gains_N(self, loads_N: Array, on_joint_N: Array = _NONE) -> Array:
        """Return what is wanted beyond loads, (4,), and beyond what acts on the joint, (k,)."""
        return np.append(SCALES * self.loads - loads_N, -on_joint_N.sum())[self.indices]

    def scale_N(self, loads_N: Array, on_joint_N: Array = _NONE) -> float:
        """Return the size of the load (4,): what is wanted, or there where nothing is held.

        What acts on the joint counts where it is more.
        """
        whole, own = loads_N.copy(), list(self.components)
        whole[own] = (SCALES * self.loads)[own]
        return float(max(np.linalg.norm(whole), np.abs(on_joint_N).max(initial=0.0)))

    def shown(self, loads_N: Array, force_unit: str) -> str:
        """Return in words the loads (4,) and those wanted."""
        units = [force_unit] * 3 + ["Nmm"]
        each = [
            f"{COMPONENTS[k]} {loads_N[k] / SCALES[k]:.4g} of {self.loads[k]:.4g} {units[k]}"
            for k in self.components
        ]
        return ", ".join(each) or "the joint"
