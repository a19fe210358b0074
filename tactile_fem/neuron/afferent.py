"""The afferent: transduction followed by the membrane, after a check of the input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.membrane import Membrane
from tactile_fem.neuron.response import Response
from tactile_fem.neuron.transduction import Transduction
from tactile_fem.study import Neuron

ROUNDING_KPA = 1e-9  # what rounding may leave below zero


def respond(time_s: ArrayLike, sed_kPa: ArrayLike, neuron: Neuron) -> Response:
    """Return the spikes that a history of strain energy density evokes.

    Parameters
    ----------
    time_s
        Increasing times of the samples, s, (t,); the indentation may have negative times.
        Receptors are unadapted and membranes at rest at the first.
    sed_kPa
        Strain energy density, kPa, (t, receptors), taken as linear between the samples.
    neuron
        Constants of transduction and membrane.

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
    time, sed = _checked(time_s, sed_kPa)
    transduction = Transduction(time, sed, neuron)
    membrane = Membrane(sed.shape[1], neuron)
    for piece in transduction.pieces():
        membrane.advance(piece)
    return Response(membrane.spikes(), float(time[0]), float(time[-1]))


def _checked(time_s: ArrayLike, sed_kPa: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    time, sed = _numbers("time_s", time_s), _numbers("sed_kPa", sed_kPa)
    if time.ndim != 1 or len(time) < 2:
        raise StudyError(f"time_s has shape {time.shape}; it needs (t,) with two times or more.")
    if sed.ndim != 2 or len(sed) != len(time):
        raise StudyError(
            f"sed_kPa has shape {sed.shape}; it needs ({len(time)}, receptors), a row per time."
        )
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        k = late[0]
        raise StudyError(
            f"time_s does not increase: {time[k + 1]:g} s follows {time[k]:g} s at row {k + 1}."
        )
    if sed.size and sed.min() <= -ROUNDING_KPA:
        row, column = np.unravel_index(sed.argmin(), sed.shape)
        raise StudyError(
            f"sed_kPa is {sed[row, column]:g} kPa at row {row}, receptor {column}; "
            "a strain energy density is never negative."
        )
    return time, np.maximum(sed, 0.0)


def _numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise StudyError(f"{name} is not an array of numbers.") from error
    wrong = ~np.isfinite(array)
    if wrong.any():
        where = tuple(int(k) for k in np.argwhere(wrong)[0])
        raise StudyError(f"{name} is {array[where]} at index {where}; all values must be finite.")
    return array
