"""Histories of a scan: one row per accepted step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.fields import STANDARD, Field

if TYPE_CHECKING:
    from tactile_fem.simulation.simulation import Observation, Simulation

Array = NDArray[Any]


class Trace:
    """Motion, load and receptors of all steps; the first row is the finger at rest.

    Columns are attributes. An observer's own columns join them; a row without a value has NaN.

    Parameters
    ----------
    receptors_mm, population
        Positions, (receptors, 3), and names of their populations, (receptors,).
    start_mm
        Where the body starts, (3,).
    fields
        Of the receptors; each is a column.

    Attributes
    ----------
    time_s, clock_s
        Per step, (steps,). The indentation ends at time 0; the clock starts with the path.
    phase
        Name of the piece of the path, (steps,).
    displacement_mm, depth_mm
        (steps,): length of the path across the finger; Z of the stimulator.
    stimulator_mm, force_N, moment_Nmm
        (steps, 3); force and moment (about the origin) act on the finger.
    contact_area_mm2, gap_error_mm, traction_error, volume_change, stored_mJ
        (steps,): see `tactile_fem.mechanics.load.Load`.
    work_mJ, friction_mJ
        Of each step, (steps,): work of the stimulator on the finger; heat of friction.
    imbalance_N, newton_iterations, linear_iterations, wall_s
        (steps,): contact force against held reaction; what the step cost.
    receptors_mm, population
        (receptors, 3), (receptors,).
    moved_mm, sed_kPa, von_mises_kPa, stretches, stresses_kPa
        (steps, receptors), displacement and principal values (steps, receptors, 3). Further
        fields follow, as drives need them.
    """

    def __init__(
        self,
        receptors_mm: Array,
        population: Array,
        start_mm: ArrayLike = (0.0, 0.0, 0.0),
        fields: Sequence[Field] = STANDARD,
    ) -> None:
        count, start = len(receptors_mm), np.asarray(start_mm, dtype=float)
        self.receptors_mm, self.population = receptors_mm, population
        self._indented_s = 0.0
        self._of_receptors = {field.name: [field.at_rest(count)] for field in fields}
        self._of_step: dict[str, list[Any]] = {
            "phase": ["rest"],
            "stimulator_mm": [start],
            "depth_mm": [start[2]],
            "force_N": [np.zeros(3)],
            "moment_Nmm": [np.zeros(3)],
            **{name: [0] for name in ("newton_iterations", "linear_iterations")},
            **{name: [0.0] for name in _SCALARS},
        }
        self._own: dict[str, list[Any]] = {}
        for name in {*self._of_step, *self._fixed, "time_s"} & self._of_receptors.keys():
            raise StudyError(f"The trace has a column {name}: choose another name for the field.")

    @classmethod
    def of(cls, simulation: Simulation) -> Trace:
        """Return the trace of a simulation at rest; an observer of its steps."""
        layout, start_mm = simulation.layout, simulation.path.start_mm
        fields = simulation.receptors.fields
        return cls(layout.positions_mm, layout.population, start_mm, fields)

    def restore(self, saved: Mapping[str, Array], rows: int) -> None:
        """Take the first `rows` rows of a saved trace.

        Raises
        ------
        StudyError
            It has fewer rows or columns.
        """
        known = {**self._of_receptors, **self._of_step}
        missing = [name for name in known if name not in saved]
        if missing or len(saved["time_s"]) < rows:
            lack = f"columns {', '.join(missing)}" if missing else f"rows: {rows} are needed"
            raise StudyError(f"The trace does not belong to its checkpoint: it lacks {lack}.")
        for columns in (self._of_receptors, self._of_step):
            columns.update({name: list(saved[name][:rows]) for name in columns})
        own = set(saved) - {*known, *self._fixed, "time_s"}
        self._own = {name: list(saved[name][:rows]) for name in sorted(own)}
        self._indented_s = float(saved["clock_s"][0] - saved["time_s"][0])

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._of_step["clock_s"])

    def __call__(self, seen: Observation) -> None:
        """Append a row: the step, what the receptors feel, and the observers' own columns."""
        step, rows = seen.step, len(self)
        values = self._checked(seen.columns)
        for name, column in self._of_receptors.items():
            column.append(seen.columns[name])
        for name, column in self._of_step.items():
            column.append(getattr(step, name))
        for name, value in values.items():
            self._own.setdefault(name, [np.full_like(value, np.nan)] * rows).append(value)
        for name in set(self._own) - set(values):
            self._own[name].append(np.full_like(self._own[name][-1], np.nan))
        if step.indenting:
            self._indented_s = step.clock_s

    def _checked(self, own: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Return an observer's values as arrays; raise StudyError where they make no column."""
        values = {}
        for name, value in own.items():
            if name in self._of_receptors:
                continue
            if name in {*self._of_step, *self._fixed, "time_s"}:
                raise StudyError(f"observers: the trace has a column {name}: choose another name.")
            try:
                values[name] = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                raise StudyError(f"observers: {name} must be numbers but is {value!r}.") from None
            shape, before = values[name].shape, np.shape(self._own.get(name, [value])[0])
            if shape != before:
                raise StudyError(
                    f"observers: {name} has the shape {shape}, before it had {before}."
                )
        return values

    def arrays(self) -> dict[str, Array]:
        """Return the columns by name."""
        columns = {**self._of_step, **self._of_receptors, **self._own}
        arrays = {name: np.array(column) for name, column in columns.items()}
        return {"time_s": self.time_s, **self._fixed, **arrays}

    @property
    def _fixed(self) -> dict[str, Array]:
        return {"receptors_mm": self.receptors_mm, "population": self.population}

    @property
    def time_s(self) -> Array:
        """Time since the end of the indentation, (steps,)."""
        return np.array(self._of_step["clock_s"]) - self._indented_s

    def __getattr__(self, name: str) -> Array:
        """Return a column."""
        if not name.startswith("_"):
            for columns in (self._of_step, self._of_receptors, self._own):
                if name in columns:
                    return np.array(columns[name])
        raise AttributeError(f"a trace has no {name}")


_SCALARS = (
    "displacement_mm",
    "clock_s",
    "contact_area_mm2",
    "gap_error_mm",
    "traction_error",
    "volume_change",
    "stored_mJ",
    "work_mJ",
    "friction_mJ",
    "imbalance_N",
    "wall_s",
)
