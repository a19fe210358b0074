"""Where a step moves the body to: along the path, and as the loads that it holds need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.finger.plane import Plane
from tactile_fem.mechanics.load import Load
from tactile_fem.path.loads import COMPONENTS, HeldLoads
from tactile_fem.path.rotations import matrix, vector

Array = np.ndarray
# Torques and turns are compared with forces and ways at this distance from the axis.
ARM_MM = 5.0
_TORQUE = 3
# From torque, Nmm, to N, and from mm to an angle, rad.
SCALES = np.array([1.0, 1.0, 1.0, 1 / ARM_MM])


@dataclass(frozen=True)
class Pose:
    """A place of the body: position (3,) of its origin, mm, and rotation (3, 3)."""

    translation: Array
    rotation: Array

    def load(self, force_N: Array, moment_Nmm: Array) -> Array:
        """Return forces, N, and the torque about Z through the body's origin, Nmm, (4,).

        `moment_Nmm` (3,) is that of the force (3,) about the origin.
        """
        return np.append(force_N, (moment_Nmm - np.cross(self.translation, force_N))[2])


@dataclass(frozen=True)
class Held:
    """The loads that a step holds.

    Unknown are the places of the body along the held components, in mm: those of the path's `pose`
    do not count, but for a turn about Z, which is added to the path's.

    Parameters
    ----------
    components
        Indices of `COMPONENTS`.
    loads
        Wanted, of all components, (4,).
    pose
        By the path at the end of the step.
    plane
        In which the finger deforms.
    """

    components: tuple[int, ...]
    loads: Array
    pose: Pose
    plane: Plane

    @classmethod
    def of(cls, held: HeldLoads, time_s: float, start: Array, pose: Pose, plane: Plane) -> Held:
        """Return what is held at a time since the piece began with the loads `start`."""
        return cls(held.components, held.at(time_s, start), pose, plane)

    def pose_at(self, x: Array) -> Pose:
        """Return the pose of the body for the unknowns, (k,)."""
        place, turn = self.pose.translation.copy(), np.zeros(3)
        for component, value in zip(self.components, x, strict=True):
            if component == _TORQUE:
                turn[2] = value / ARM_MM
            else:
                place[component] = value
        return Pose(place, matrix(turn) @ self.pose.rotation)

    def unknowns(self, pose: Pose, path: Pose) -> Array:
        """Return the unknowns, (k,), of a pose where the path is at another one."""
        turn = vector(pose.rotation @ path.rotation.T)[2] * ARM_MM
        return np.append(pose.translation, turn)[list(self.components)]

    def loads_of(self, pose: Pose, load: Load) -> Array:
        """Return the load on the finger, (4,), in N."""
        force, moment = self.plane.vectors(load.force_N), self.plane.moment(load.moment_Nmm)
        return SCALES * pose.load(force, moment)

    def excess_N(self, loads_N: Array) -> Array:
        """Return by how much loads (4,) exceed those wanted, (k,)."""
        return (loads_N - SCALES * self.loads)[list(self.components)]

    def scale_N(self, loads_N: Array) -> float:
        """Return the size of the load (4,): what is wanted, or there where nothing is held."""
        whole = loads_N.copy()
        whole[list(self.components)] -= self.excess_N(loads_N)
        return float(np.linalg.norm(whole))

    def shown(self, loads_N: Array) -> str:
        """Return in words the loads (4,) and those wanted."""
        units = [self.plane.force_unit] * 3 + ["Nmm"]
        return ", ".join(
            f"{COMPONENTS[k]} {loads_N[k] / SCALES[k]:.4g} of {self.loads[k]:.4g} {units[k]}"
            for k in self.components
        )
