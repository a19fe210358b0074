"""Histories of a scan: one row per accepted step."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError

Array = NDArray[Any]


@dataclass(frozen=True)
class Trace:
    """What happened and what the receptors felt; the first row is the finger at rest.

    Attributes
    ----------
    time_s, displacement_mm, depth_mm, clock_s
        Per step, (steps,). The slide starts at time 0, the indentation has negative times;
        the clock starts with the indentation.
    stimulator_mm, force_N, moment_Nmm
        (steps, 3); force and moment (about the origin) act on the finger.
    contact_area_mm2, gap_error_mm, traction_error, volume_change, stored_mJ
        (steps,): see `tactile_fem.mechanics.load.Load`.
    work_mJ, friction_mJ
        Of each step, (steps,): work of the stimulator on the finger; heat of friction.
    imbalance_N, newton_iterations, linear_iterations, wall_s
        (steps,): contact force against held reaction; what the step cost.
    receptors_mm
        (receptors, 3).
    population
        Name of each receptor's population, (receptors,).
    sed_kPa, von_mises_kPa, stretches, stresses_kPa
        (steps, receptors), (steps, receptors), (steps, receptors, 3) and again; see
        `tactile_fem.receptors.probe.ReceptorState`.
    """

    time_s: Array
    displacement_mm: Array
    depth_mm: Array
    clock_s: Array
    stimulator_mm: Array
    force_N: Array
    moment_Nmm: Array
    contact_area_mm2: Array
    gap_error_mm: Array
    traction_error: Array
    volume_change: Array
    stored_mJ: Array
    work_mJ: Array
    friction_mJ: Array
    imbalance_N: Array
    newton_iterations: Array
    linear_iterations: Array
    wall_s: Array
    receptors_mm: Array
    population: Array
    sed_kPa: Array
    von_mises_kPa: Array
    stretches: Array
    stresses_kPa: Array

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


class Histories:
    """Collects rows and makes a `Trace` of them.

    Parameters
    ----------
    receptors_mm, population
        Positions, (receptors, 3), and names of their populations, (receptors,).
    """

    def __init__(self, receptors_mm: Array, population: Array) -> None:
        count = len(receptors_mm)
        self.receptors_mm, self.population = receptors_mm, population
        self._columns: dict[str, list[Any]] = {
            "displacement_mm": [0.0],
            "depth_mm": [0.0],
            "clock_s": [0.0],
            "stimulator_mm": [np.zeros(3)],
            "force_N": [np.zeros(3)],
            "moment_Nmm": [np.zeros(3)],
            "contact_area_mm2": [0.0],
            "gap_error_mm": [0.0],
            "traction_error": [0.0],
            "volume_change": [0.0],
            "stored_mJ": [0.0],
            "work_mJ": [0.0],
            "friction_mJ": [0.0],
            "imbalance_N": [0.0],
            "newton_iterations": [0],
            "linear_iterations": [0],
            "wall_s": [0.0],
            "sed_kPa": [np.zeros(count)],
            "von_mises_kPa": [np.zeros(count)],
            "stretches": [np.ones((count, 3))],
            "stresses_kPa": [np.zeros((count, 3))],
        }

    @classmethod
    def from_trace(cls, trace: dict[str, Array], rows: int) -> Histories:
        """Return the first `rows` rows of a saved trace.

        Raises
        ------
        StudyError
            It has fewer rows or columns.
        """
        histories = cls(trace["receptors_mm"], trace["population"])
        missing = [name for name in histories._columns if name not in trace]
        if missing or len(trace["time_s"]) < rows:
            lack = f"columns {', '.join(missing)}" if missing else f"rows: {rows} are needed"
            raise StudyError(f"The trace does not belong to its checkpoint: it lacks {lack}.")
        for name in histories._columns:
            histories._columns[name] = list(trace[name][:rows])
        return histories

    def add(self, step: Any, felt: Any) -> None:
        """Append a row: the attributes of a step, and what the receptors feel at it."""
        for name, column in self._columns.items():
            column.append(getattr(felt if hasattr(felt, name) else step, name))

    def trace(self) -> Trace:
        """Return the histories so far."""
        columns = {name: np.array(column) for name, column in self._columns.items()}
        pressed = columns["clock_s"][columns["displacement_mm"] == 0.0][-1]
        time_s = columns["clock_s"] - pressed
        fixed = {"receptors_mm": self.receptors_mm, "population": self.population}
        return Trace(time_s=time_s, **fixed, **columns)
