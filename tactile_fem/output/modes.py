"""Shapes of the finger that vibrates, as films and pictures show them."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import write_arrays

Array = NDArray[Any]


class Archived:
    """A dataclass of arrays with a file of them."""

    def save(self, path: Path) -> None:
        """Write all fields as a compressed NumPy archive."""
        write_arrays(path, vars(self), compressed=True)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Return what `save` wrote; StudyError if it cannot be read."""
        try:
            with np.load(path, allow_pickle=False) as arrays:
                known = [one.name for one in fields(cast(Any, cls))]
                return cls(**{name: arrays[name] for name in known if name in arrays})
        except (OSError, TypeError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise StudyError(f"{path} cannot be read as a vibration: {error}.") from None


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
        The mesh in its file's order: (n, 3); (m, 10), gmsh's order; (m,) tags.
    stimulator_mm
        Position of the body in the state, (3,).
    body
        How the body vibrates, (3,): a unit vector, or 0 if the bone vibrates.
    stimulator_rad
        Rotation vector of the body in the state, (3,).
    """

    frequency_Hz: Array
    moved: Array
    still_mm: Array
    nodes_mm: Array
    tets: Array
    tissue: Array
    stimulator_mm: Array
    body: Array
    stimulator_rad: Array = field(default_factory=lambda: np.zeros(3))  # older files lack it

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
