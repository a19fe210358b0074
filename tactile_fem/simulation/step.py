"""One accepted step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.mechanics.load import Load
from tactile_fem.path.rotations import moment_about


@dataclass(frozen=True)
class Step:
    """One accepted step: position of the body, load, and cost.

    A quantity of a step in `trace.npz` has the same name here or in `load`, but for its `time_s`,
    which counts from the end of the indentation and is known only then.

    Attributes
    ----------
    load
        Forces in space, contact area and energies at its end.
    index
        From 1 on.
    phase
        Name of the piece of the path.
    indenting
        Whether the step belongs to the indentation.
    displacement_mm
        Length of the path across the finger so far.
    dt_s, clock_s
        Duration of the step; time since the start.
    stimulator_mm
        Position of the body relative to where it touches the undeformed pad's apex, (3,).
    stimulator_rad
        Rotation vector of the body about its origin: axis times angle, (3,).
    bone_rad
        Angle of the bone about its joint.
    solves, newton_iterations, linear_iterations
        Solves on the way to this step, and the iterations of them all; some failed or did not meet
        the wanted loads.
    output, ends_piece
        Whether the path asked for output here, or its piece for none; whether the piece ends here.
    fraction
        Share of the whole path's steps that is done.
    wall_s
        Time that all of them took.
    force_unit
        "N", in a section "N/mm" of its width; likewise "mm2" is mm and "mJ" mJ/mm there.
    """

    load: Load
    index: int
    phase: str
    indenting: bool
    displacement_mm: float
    dt_s: float
    clock_s: float
    stimulator_mm: np.ndarray
    stimulator_rad: np.ndarray
    bone_rad: float
    solves: int
    newton_iterations: int
    linear_iterations: int
    output: bool
    ends_piece: bool
    fraction: float
    wall_s: float
    force_unit: str = "N"

    @property
    def depth_mm(self) -> float:
        """Z of `stimulator_mm`."""
        return float(self.stimulator_mm[2])

    @property
    def torque_Nmm(self) -> float:
        """Torque on the finger about Z through the body's origin."""
        return float(moment_about(self.stimulator_mm, self.load.force_N, self.load.moment_Nmm)[2])

    def __str__(self) -> str:
        """Return one line that describes the step."""
        x, y, normal = self.load.force_N
        normal, tangential = round(float(normal), 4) + 0.0, (x**2 + y**2) ** 0.5  # no -0.0000
        turn = ""
        if self.stimulator_rad.any():
            turn = f"turned {np.degrees(np.linalg.norm(self.stimulator_rad)):.1f} deg  "
        if self.stimulator_rad[2]:
            turn += f"torque {self.torque_Nmm:.3f} Nmm  "
        return (
            f"step {self.index:3d}  {self.phase:5s} {self.displacement_mm:6.3f} mm  "
            f"depth {self.depth_mm:.3f} mm  normal {normal:.4f} {self.force_unit}  "
            f"tangential {tangential:.4f} {self.force_unit}  "
            f"{turn}{self.newton_iterations:2d} iterations"
        )
