"""What a step balances: the loads that it holds, and the moments on the joint."""

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


@dataclass(frozen=True)
class LoadBalance:
    """The loads that a step holds, and the bone whose moments are in balance if it has a joint.

    The unknowns are the body's positions along the held forces and its turn about Z, times an arm,
    for a held torque: there the path's `pose` has no effect, but for a turn, to which the unknown
    one is added. With a joint, the last unknown is the displacement of the bone at the contact
    point along -Z. All are in mm. Without any, the body follows the path.

    Parameters
    ----------
    components
        Indices of `COMPONENTS`.
    loads
        Wanted, of all components, (4,).
    pose
        Pose by the path at the end of the step.
    bone
        Bone after the last accepted step; None if it is clamped.
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

    def missing_N(self, loads_N: Array, on_joint_N: Array) -> Array:
        """Return by how much the loads are too small, (k,).

        `loads_N` are those on the finger, (4,), and `on_joint_N` what is to sum up to zero.
        """
        return np.append(SCALES * self.loads - loads_N, -on_joint_N.sum())[self.indices]

    def scale_N(self, loads_N: Array, on_joint_N: Array) -> float:
        """Return the largest load: those wanted, and those found where nothing is held."""
        whole, own = loads_N.copy(), list(self.components)
        whole[own] = (SCALES * self.loads)[own]
        return float(max(np.abs(whole).max(), np.abs(on_joint_N).max(initial=0.0)))

    def shown(self, loads_N: Array, force_unit: str) -> str:
        """Return in words the loads (4,) and those wanted."""
        units = [force_unit] * 3 + ["Nmm"]
        each = [
            f"{COMPONENTS[k]} {loads_N[k] / SCALES[k]:.4g} of {self.loads[k]:.4g} {units[k]}"
            for k in self.components
        ]
        return ", ".join(each) or "the joint"
