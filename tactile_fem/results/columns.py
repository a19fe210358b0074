"""Columns of the tables in a results folder: what their writers use and the reference shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

_UNITS = ("mm", "mm2", "s", "N", "Nmm", "mJ", "kPa", "rad")


class Column(NamedTuple):
    """A column of a table.

    Attributes
    ----------
    name
        Name with the unit at its end.
    shape
        Numbers and names of the dimensions; of a CSV file ``rows``.
    meaning
        Meaning in a few words, in Markdown.
    rest
        Value in the finger at rest, which is the first row of a trace.
    """

    name: str
    shape: tuple[str | int, ...]
    meaning: str
    rest: Any = 0.0

    @property
    def unit(self) -> str:
        """Unit, as the name states it; empty for pure numbers."""
        last = self.name.rpartition("_")[2]
        return last if last in _UNITS else ""

    def sizes(self, **of: int) -> tuple[int, ...]:
        """Return the shape as numbers, given the numbers of ``steps`` and ``receptors``."""
        return tuple(size if isinstance(size, int) else of[size] for size in self.shape)


_STEPS, _RECEPTORS, _BOTH = ("steps",), ("receptors",), ("steps", "receptors")
_ORIGIN = (0.0, 0.0, 0.0)

# One value for each step, as `tactile_fem.simulation.step.Step` has it.
OF_STEP = (
    Column("clock_s", _STEPS, "time since the start of the path"),
    Column("phase", _STEPS, "name of the piece of the path, such as `press` or `slide`", "rest"),
    Column("displacement_mm", _STEPS, "length of the path across the finger; 0 while indenting"),
    Column("depth_mm", _STEPS, "depth of the stimulator: Z of `stimulator_mm`"),
    Column("stimulator_mm", (*_STEPS, 3), "position of the stimulator", _ORIGIN),
    Column("stimulator_rad", (*_STEPS, 3), "its rotation vector, axis times angle", _ORIGIN),
    Column("bone_rad", _STEPS, "angle of the bone about its joint; positive away from the pad"),
    Column("force_N", (*_STEPS, 3), "force of the stimulator on the finger", _ORIGIN),
    Column("moment_Nmm", (*_STEPS, 3), "moment of this force about the origin", _ORIGIN),
    Column("contact_area_mm2", _STEPS, "skin within 0.01 mm of the stimulator"),
    Column("volume_change", _STEPS, "relative change of the volume of the soft tissue"),
    Column("stored_mJ", _STEPS, "strain energy"),
    Column(
        "work_mJ",
        _STEPS,
        "work of the stimulator in the step; what neither friction takes nor `stored_mJ` gains is "
        "dissipated by viscosity",
    ),
    Column("friction_mJ", _STEPS, "frictional heat in the step"),
    Column("gap_error_mm", _STEPS, "distance of the skin from what it presses, by pressure"),
    Column(
        "traction_error",
        _STEPS,
        "normal traction of the tissue less that of the contact, relative; it vanishes with the "
        "mesh size",
    ),
    Column("imbalance_N", _STEPS, "contact force less the reaction of the rest of the finger"),
    Column("newton_iterations", _STEPS, "Newton iterations of the step", 0),
    Column("linear_iterations", _STEPS, "iterations of the linear solver in the step", 0),
    Column("wall_s", _STEPS, "computing time of the step"),
)

# What the receptors feel: `tactile_fem.neuron.fields.STANDARD`. Drives add columns of their own.
FELT = (
    Column("sed_kPa", _BOTH, "strain energy density"),
    Column("von_mises_kPa", _BOTH, "von Mises stress"),
    Column("stretches", (*_BOTH, 3), "principal stretches, in increasing order"),
    Column("stresses_kPa", (*_BOTH, 3), "principal Cauchy stresses, likewise, tension positive"),
    Column("moved_mm", (*_BOTH, 3), "displacement of the receptors"),
)

# One value for each receptor.
OF_RECEPTOR = (
    Column("receptors_mm", (*_RECEPTORS, 3), "undeformed positions, population by population"),
    Column("population", _RECEPTORS, "its name; `SA1` in a study without `[[afferents]]`"),
    Column("directions", (*_RECEPTORS, 3), "preferred ones: unit vectors, tangent to the skin"),
)

TRACE = (
    Column("time_s", _STEPS, "time since the end of the indentation, negative before"),
    *OF_STEP,
    *OF_RECEPTOR,
    *FELT,
)

SPIKES = tuple(
    Column(name, ("rows",), meaning)
    for name, meaning in (
        ("receptor", "index of the receptor in `trace.npz`"),
        ("time_s", "time of the spike, as `time_s` in `trace.npz`"),
        ("displacement_mm", "displacement at this time"),
        ("population", "name of the population"),
    )
)

# Of a series: the values that it varies stand after `scan`, under their names in the study, or as
# `shift_mm`; the spikes of each population at the end.
SUMMARY = tuple(
    Column(name, ("rows",), meaning)
    for name, meaning in (
        ("scan", "folder of the scan"),
        ("status", "`complete`, or `not complete`, with empty columns after it; `failed` says why"),
        ("steps", "number of rows of `trace.npz`"),
        ("newton_iterations", "of all steps"),
        ("wall_s", "computing time of all steps"),
        ("pressed_N", "normal force at the end of the indentation"),
        ("normal_N", "normal force, mean over the time of the slide"),
        ("tangential_N", "magnitude of the tangential force, mean over the time of the slide"),
        ("contact_area_mm2", "contact area, mean over the time of the slide"),
        ("largest_sed_kPa", "largest strain energy density of all receptors in the slide"),
        ("central_largest_sed_kPa", "the same for the receptor nearest to the origin"),
        ("spikes", "of all receptors from the end of the indentation on"),
        ("central_spikes", "of the receptor nearest to the origin"),
    )
)


def check_trace(trace: Mapping[str, Any]) -> None:
    """Raise ValueError unless all arrays of a trace have the same steps and receptors."""
    steps = trace["time_s"].shape
    receptors = len(trace.get("receptors_mm", ()))
    if len(steps) != 1:
        raise ValueError(f"time_s has shape {steps}, not (steps,)")
    shapes = {column.name: column.sizes(steps=steps[0], receptors=receptors) for column in TRACE}
    for name, array in trace.items():
        expected = shapes.get(name, steps)
        if array.shape[: len(expected)] != expected:
            raise ValueError(f"{name} has shape {array.shape}, not {expected}")


_TABLES = {"trace": TRACE, "spikes": SPIKES, "summary": SUMMARY}


def table(name: str = "trace") -> list[tuple[str, str, str, str]]:
    """Return name, shape, unit and meaning of each column of a table, for the reference.

    Parameters
    ----------
    name
        ``trace``, ``spikes`` or ``summary``: `trace.npz`, `spikes.csv` or `summary.csv`.
    """
    return [
        (column.name, ", ".join(map(str, column.shape)), column.unit, column.meaning)
        for column in _TABLES[name]
    ]
