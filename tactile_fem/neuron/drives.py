"""Drives: what afferents respond to, computed from the histories of their receptors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.fields import RIGHT_CAUCHY_GREEN, Field, stretch_along
from tactile_fem.runtime.own_code import Code

Array = NDArray[Any]
Histories = Mapping[str, Array]
# Columns of a trace with a row for each receptor; with three numbers for each step.
_OF_RECEPTORS = ("receptors_mm", "population", "directions")
_OF_BODY = ("stimulator_mm", "stimulator_rad", "force_N", "moment_Nmm")
_ROUNDING_KPA = 1e-9  # rounding may make zero as negative as this


@dataclass(frozen=True)
class Drive:
    """A quantity that afferents respond to.

    Attributes
    ----------
    label, unit
        Its name in figures, and its unit.
    value
        Takes the arrays of a trace, with ``time_s`` (t,), columns of the receptors
        (t, receptors, ...), their places ``receptors_mm`` and preferred ``directions``
        (receptors, 3), and returns the quantity, (t, receptors). Receptors are those of the
        population that feels it, and no others.
    fields
        Columns of the receptors that it needs besides those of every trace.
    """

    label: str
    unit: str
    value: Callable[[Histories], Array]
    fields: tuple[Field, ...] = ()

    def of(self, histories: Histories) -> tuple[Array, Array]:
        """Return times, s, (t,), and the quantity, (t, receptors).

        Raises StudyError if a history is missing, or the quantity is not finite or has another
        shape.
        """
        try:
            value = self.value(histories)
        except KeyError as missing:
            raise StudyError(f"{self.label}: the histories have no {missing.args[0]}.") from None
        return checked(histories["time_s"], value, self.label)

    def rate(self) -> Drive:
        """Return its rate of change: second-order differences, one-sided at the ends.

        They are exact for parabolas at any spacing of the samples. Between the samples the rate is
        linear, as every drive is.
        """

        def value(histories: Histories) -> Array:
            time_s = histories["time_s"]
            order: Literal[1, 2] = 2 if len(time_s) > 2 else 1
            return np.gradient(self.value(histories), time_s, axis=0, edge_order=order)

        label = f"Rate of {self.label[0].lower()}{self.label[1:]}"
        return Drive(label, f"{self.unit}/s", value, self.fields)


def histories_of(population: str, histories: Histories) -> Histories:
    """Return histories with the receptors of one population only.

    Columns that no field has count as the receptors' if they have the shape (t, receptors, ...).
    """
    own, found = histories["population"] == population, dict(histories)
    for name, column in histories.items():
        if name in _OF_RECEPTORS:
            found[name] = column[own]
        elif column.shape[:2] == (len(histories["time_s"]), len(own)) and name not in _OF_BODY:
            found[name] = column[:, own]
    return found


def checked_sed(time_s: ArrayLike, sed_kPa: ArrayLike) -> tuple[Array, Array]:
    """Return a history of strain energy density as arrays, or raise what `respond` raises."""
    time, sed = checked(time_s, sed_kPa, "sed_kPa")
    if sed.size and sed.min() <= -_ROUNDING_KPA:
        row, column = np.unravel_index(sed.argmin(), sed.shape)
        raise StudyError(
            f"sed_kPa is {sed[row, column]:g} kPa at row {row}, receptor {column}; "
            "a strain energy density is never negative, other drives may be: name what is felt."
        )
    return time, np.maximum(sed, 0.0)


def checked(time_s: ArrayLike, drive: ArrayLike, name: str) -> tuple[Array, Array]:
    """Return a history of either sign as arrays, or raise what `respond` raises."""
    time, values = _numbers("time_s", time_s), _numbers(name, drive)
    if time.ndim != 1 or len(time) < 2:
        raise StudyError(f"time_s has shape {time.shape}; it needs (t,) with two times or more.")
    if values.ndim != 2 or len(values) != len(time):
        raise StudyError(
            f"{name} has shape {values.shape}; it needs ({len(time)}, receptors), a row per time."
        )
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        k = late[0]
        raise StudyError(
            f"time_s does not increase: {time[k + 1]:g} s follows {time[k]:g} s at row {k + 1}."
        )
    return time, values


def _numbers(name: str, values: ArrayLike) -> Array:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise StudyError(f"{name} is not an array of numbers.") from error
    wrong = ~np.isfinite(array)
    if wrong.any():
        where = tuple(int(k) for k in np.argwhere(wrong)[0])
        raise StudyError(f"{name} is {array[where]} at index {where}; all values must be finite.")
    return array


# Drives by name; your own may be added. Principal values increase; tension is positive.
DRIVES: dict[str, Drive] = {
    "sed": Drive(
        "Strain energy density", "kPa", lambda h: checked_sed(h["time_s"], h["sed_kPa"])[1]
    ),
    "von_mises": Drive("Von Mises stress", "kPa", lambda h: h["von_mises_kPa"]),
    "largest_stretch": Drive("Largest stretch - 1", "1", lambda h: h["stretches"][..., -1] - 1),
    "smallest_stretch": Drive("Smallest stretch - 1", "1", lambda h: h["stretches"][..., 0] - 1),
    "largest_stress": Drive("Largest stress", "kPa", lambda h: h["stresses_kPa"][..., -1]),
    "smallest_stress": Drive("Smallest stress", "kPa", lambda h: h["stresses_kPa"][..., 0]),
    "compression": Drive("1 - smallest stretch", "1", lambda h: 1 - h["stretches"][..., 0]),
    "indentation": Drive("Displacement into the finger", "mm", lambda h: h["moved_mm"][..., 2]),
    "directed_stretch": Drive(
        "Directed stretch - 1",
        "1",
        lambda h: stretch_along(h["right_cauchy_green"], h["directions"]) - 1,
        (RIGHT_CAUCHY_GREEN,),
    ),
    "pressure": Drive("Pressure", "kPa", lambda h: -h["stresses_kPa"].mean(axis=-1)),
}


def drive_of(name: str) -> Drive:
    """Return a drive by its name, with the ending ``_rate`` its rate; StudyError if unknown."""
    if name in DRIVES:
        return DRIVES[name]
    if isinstance(name, Code):
        found, label = name.load(also=Drive), name.rpartition(":")[2].replace("_", " ").capitalize()
        return found if isinstance(found, Drive) else Drive(label, "1", name.running()(found))
    base = name.removesuffix("_rate")
    if base == name or base not in DRIVES:
        known = ", ".join(DRIVES)
        raise StudyError(f'There is no drive "{name}"; there are {known}, and their "_rate".')
    return DRIVES[base].rate()
