"""The shape of a vibrating finger: complex displacements of all nodes at some frequencies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.vibration.archive import Archived

Array = NDArray[Any]


@dataclass(frozen=True)
class Modes(Archived):
    """Motion of the whole finger in a vibration about a state.

    Attributes
    ----------
    frequency_Hz
        (f,).
    moved
        Complex displacement amplitudes per mm of the vibration, (f, n, 3), single precision. The
        real part of the amplitude times ``exp(i w t)`` is the displacement.
    still_mm
        Displacement of the state itself, (n, 3).
    nodes_mm, tets, tissue
        Of the mesh, in its file's order: (n, 3); (m, 10), gmsh's order; (m,) tags.
    stimulator_mm
        Position of the body in the state, (3,).
    body
        How the body vibrates, (3,): a unit vector, or 0 if the bone vibrates.
    """

    frequency_Hz: Array
    moved: Array
    still_mm: Array
    nodes_mm: Array
    tets: Array
    tissue: Array
    stimulator_mm: Array
    body: Array

    def nearest(self, frequency_Hz: float) -> int:
        """Return the number of the frequency nearest to one, by their ratio."""
        return int(nearest(self.frequency_Hz, [frequency_Hz])[0])

    def largest_phase(self, k: int) -> float:
        """Return the phase w t, rad, at which the nodes' mean square displacement is largest."""
        # |Re(a e^(i p))|^2 = (|a|^2 + Re(a.a e^(2 i p)))/2
        return float(-0.5 * np.angle(np.sum(self.moved[k].astype(complex) ** 2)))


def nearest(frequencies_Hz: ArrayLike, wanted_Hz: ArrayLike) -> NDArray[np.intp]:
    """Return the numbers, rising, of the frequencies nearest to the wanted ones, by their ratio."""
    logs, wanted = np.log(frequencies_Hz), np.log(wanted_Hz)
    return np.unique(np.abs(logs[:, None] - wanted).argmin(axis=0))


def few_of(frequencies_Hz: ArrayLike) -> Array:
    """Return the lowest, the middle and the highest frequency: shapes of all nodes are large."""
    rising = np.sort(np.asarray(frequencies_Hz, dtype=float))
    return np.unique(rising[[0, len(rising) // 2, -1]])
