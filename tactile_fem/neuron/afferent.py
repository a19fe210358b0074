"""The afferent: transduction followed by the membrane, after a check of the input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.membrane import Membrane
from tactile_fem.neuron.response import Response
from tactile_fem.neuron.transduction import Transduction, transduction_of
from tactile_fem.neuron.variability import Variability
from tactile_fem.study import Neuron

Array = NDArray[Any]
ROUNDING_KPA = 1e-9  # what rounding may leave below zero


def respond(
    time_s: ArrayLike,
    sed_kPa: ArrayLike,
    neuron: Neuron | None = None,
    units: ArrayLike | None = None,
) -> Response:
    """Return the spikes that a history of strain energy density evokes.

    Strain energy density is linear between the samples. Current and potential are then exact,
    and spikes are found to rounding: samples that add nothing to the history change nothing.

    Parameters
    ----------
    time_s
        Increasing times of the samples, s, (t,); the indentation may have negative times.
        Receptors are unadapted and membranes at rest at the first.
    sed_kPa
        Strain energy density, kPa, (t, receptors). Other drives: `Population`.
    neuron
        Constants of transduction and membrane; default ``Neuron()``.
    units
        Numbers of the afferents, (receptors,), which their random numbers belong to; default 0,
        1, 2 ... So parts of a population fire as the whole does.

    Returns
    -------
    Response
        Spikes per receptor.

    Raises
    ------
    StudyError
        Shapes that do not fit, values that are not finite, times that do not increase, negative
        strain energy density.
    """
    neuron = neuron or Neuron()
    time, sed = checked_history(time_s, sed_kPa)
    return fire(time, sed, neuron, transduction_of(neuron), units)


def fire(
    time: Array,
    drive: Array,
    neuron: Neuron,
    transduction: Transduction,
    units: ArrayLike | None = None,
) -> Response:
    """Return the spikes that a checked history evokes through any transduction."""
    variability = Variability(neuron, _numbered(units, drive.shape[1]))
    membrane = Membrane(neuron, variability)
    if neuron.gain_spread:
        drive = drive * variability.gains()  # the current is homogeneous in the drive
    for segment in transduction.segments(time, drive):
        membrane.advance(segment)
    return Response(membrane.spikes(), float(time[0]), float(time[-1]))


def _numbered(units: ArrayLike | None, count: int) -> NDArray[np.int64]:
    numbers = np.arange(count) if units is None else np.asarray(units)
    whole = numbers.shape == (count,) and np.issubdtype(numbers.dtype, np.integer)
    if not whole or (numbers < 0).any():
        raise StudyError(f"units must be {count} whole numbers from 0 on, one per receptor.")
    return numbers


def checked_history(time_s: ArrayLike, sed_kPa: ArrayLike) -> tuple[Array, Array]:
    """Return history as arrays, or raise what `respond` raises."""
    time, sed = checked_signed(time_s, sed_kPa, "sed_kPa")
    if sed.size and sed.min() <= -ROUNDING_KPA:
        row, column = np.unravel_index(sed.argmin(), sed.shape)
        raise StudyError(
            f"sed_kPa is {sed[row, column]:g} kPa at row {row}, receptor {column}; "
            "a strain energy density is never negative."
        )
    return time, np.maximum(sed, 0.0)


def checked_signed(time_s: ArrayLike, drive: ArrayLike, name: str) -> tuple[Array, Array]:
    """Return a history that may be negative as arrays, or raise what `respond` raises."""
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
