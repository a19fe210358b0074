"""Histories of a scan: one row per accepted step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.fields import STANDARD, Field
from tactile_fem.results.columns import OF_STEP

Array = NDArray[Any]


class Trace:
    """Motion, load and receptors of all steps; the first row is the finger at rest.

    Columns are attributes: those of `tactile_fem.results.columns.OF_STEP`, one for each of the
    `fields` of the receptors, and the observers' own, where a row without a value has NaN.

    Attributes
    ----------
    receptors_mm, population, directions
        Undeformed positions, (receptors, 3), names of their populations, (receptors,), and
        preferred directions, (receptors, 3); NaN by default.
    time_s
        (steps,). The indentation ends at time 0; ``clock_s`` starts with the path.
    """

    def __init__(
        self,
        receptors_mm: Array,
        population: Array,
        start_mm: ArrayLike = (0.0, 0.0, 0.0),
        start_rad: ArrayLike = (0.0, 0.0, 0.0),
        fields: Sequence[Field] = STANDARD,
        directions: Array | None = None,
    ) -> None:
        count, start = len(receptors_mm), np.asarray(start_mm, dtype=float)
        unknown = np.full_like(receptors_mm, np.nan)
        self._fixed = {
            "receptors_mm": receptors_mm.copy(),
            "population": population.copy(),
            "directions": unknown if directions is None else directions.copy(),
        }
        self._indented_s = 0.0
        of_step = {column.name: column.rest for column in OF_STEP}
        of_step |= {"stimulator_mm": start, "depth_mm": start[2]}
        of_step["stimulator_rad"] = np.asarray(start_rad, dtype=float)
        felt = {field.name: field.at_rest(count) for field in fields}
        self._of_step, self._felt = tuple(of_step), tuple(felt)
        self._reserved = {*of_step, *self._fixed, "time_s"}
        for name in self._reserved & felt.keys():
            raise StudyError(f"The trace has a column {name}: choose another name for the field.")
        self._columns = {name: [value] for name, value in {**of_step, **felt}.items()}

    @classmethod
    def of(cls, simulation: Any) -> Trace:
        """Return the trace of a simulation at rest; an observer of its steps."""
        layout, path = simulation.layout, simulation.path
        fields = simulation.receptors.fields
        starts = path.start_mm, path.start_rad
        return cls(layout.positions_mm, layout.population, *starts, fields, layout.directions)

    @classmethod
    def read(cls, saved: Mapping[str, Array]) -> Trace:
        """Return the trace that a results folder has saved.

        Raises
        ------
        StudyError
            It lacks a column.
        """
        fixed = saved["receptors_mm"], saved["population"]
        trace = cls(*fixed, fields=(), directions=saved.get("directions"))
        trace.restore(saved, len(saved["time_s"]))
        return trace

    def restore(self, saved: Mapping[str, Array], rows: int) -> None:
        """Take the first `rows` rows of a saved trace.

        Raises
        ------
        StudyError
            It has fewer rows or columns.
        """
        missing = [name for name in (*self._felt, *self._of_step) if name not in saved]
        if missing or len(saved["time_s"]) < rows:
            lack = f"columns {', '.join(missing)}" if missing else f"rows: {rows} are needed"
            raise StudyError(f"The trace does not belong to its checkpoint: it lacks {lack}.")
        names = [name for name in saved if name not in {*self._fixed, "time_s"}]
        self._columns = {name: list(saved[name][:rows]) for name in names}
        self._indented_s = float(saved["clock_s"][0] - saved["time_s"][0])

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._columns["clock_s"])

    def __call__(self, seen: Any) -> None:
        """Append a row: the step, what the receptors feel, and the observers' own columns."""
        rows, own, step = len(self), self._checked(seen.columns), seen.step
        of_step = {
            name: getattr(step if hasattr(step, name) else step.load, name)
            for name in self._of_step
        }
        row = {**of_step, **{name: seen.columns[name] for name in self._felt}, **own}
        for name, value in own.items():
            self._columns.setdefault(name, [np.full_like(value, np.nan)] * rows)
        for name, column in self._columns.items():
            # Copied: a part of an array would keep all of it in memory.
            column.append(copy(row[name]) if name in row else np.full_like(column[-1], np.nan))
        if seen.step.indenting:
            self._indented_s = seen.step.clock_s

    def _checked(self, columns: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Return the observers' values as arrays; raise StudyError where they make no column."""
        values = {}
        for name in [name for name in columns if name not in self._felt]:
            value = columns[name]
            if name in self._reserved:
                raise StudyError(f"observers: the trace has a column {name}: choose another name.")
            try:
                values[name] = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                raise StudyError(f"observers: {name} must be numbers but is {value!r}.") from None
            shape, before = values[name].shape, np.shape(self._columns.get(name, [value])[0])
            if shape != before:
                raise StudyError(
                    f"observers: {name} has the shape {shape}, before it had {before}."
                )
        return values

    def arrays(self) -> dict[str, Array]:
        """Return the columns by name."""
        columns = {name: np.array(column) for name, column in self._columns.items()}
        return {"time_s": self.time_s, **self._fixed, **columns}

    def last(self) -> tuple[int, float, dict[str, Array]]:
        """Return the number of the last row, the end of the indentation on the clock, its values.

        It costs the same however many rows there are; see `tactile_fem.results.store`.
        """
        row = {name: np.asarray(column[-1]) for name, column in self._columns.items()}
        return len(self) - 1, self._indented_s, row

    def at(self, name: str, rows: Sequence[int]) -> Array:
        """Return the values of a column in some rows, likewise."""
        if name == "time_s":
            return self.at("clock_s", rows) - self._indented_s
        return np.array([self._columns[name][row] for row in rows])

    @property
    def time_s(self) -> Array:
        """Time since the end of the indentation, (steps,)."""
        return np.array(self._columns["clock_s"]) - self._indented_s

    def __getattr__(self, name: str) -> Array:
        """Return a column."""
        if name in vars(self).get("_fixed", ()):
            return self._fixed[name]
        if name in vars(self).get("_columns", ()):
            return np.array(self._columns[name])
        raise AttributeError(f"a trace has no {name}")
