"""Keeps the finger's shape at some frequencies of `tactile_fem.vibrate`."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray

from tactile_fem.vibration.harmonic import HarmonicResponse
from tactile_fem.vibration.modes import Modes
from tactile_fem.vibration.vibrate import OperatingPoint

Array = NDArray[Any]


class ModeKeeper:
    """An observer of `vibrate` that keeps the displacement of all nodes.

    Parameters
    ----------
    frequencies_Hz
        Where it is kept, equal to some of the computed frequencies.
    """

    def __init__(self, frequencies_Hz: ArrayLike) -> None:
        self._wanted = np.asarray(frequencies_Hz)
        self._kept: dict[float, Array] = {}
        self._point: OperatingPoint | None = None

    def __call__(self, point: OperatingPoint, response: HarmonicResponse) -> None:
        """Keep the displacement if it is wanted at this frequency; all ranks call."""
        if response.frequency_Hz not in self._wanted:
            return
        problem = point.simulation.problem
        if self._point is None:
            self._point = point
            self._still = problem.order.gather(problem.u).astype(np.float32)
        values = fem.Function(problem.u.function_space)

        def gathered(of_space: ArrayLike) -> Array:
            values.x.array[:] = of_space
            return problem.order.gather(values)

        inside = gathered(1.0) != 0  # rigid tissues are outside the space
        moved = gathered(response.u.real) + 1j * gathered(response.u.imag)
        kept = np.where(inside, moved, point.bone).astype(np.complex64)
        self._kept[response.frequency_Hz] = kept

    def modes(self) -> Modes | None:
        """Return what was kept, on the first rank; None on the others or if there is nothing."""
        if self._point is None or self._point.simulation.finger is None:
            return None
        finger = self._point.simulation.finger
        return Modes(
            np.array(list(self._kept)),
            np.array(list(self._kept.values())),
            self._still,
            finger.nodes.astype(np.float32),
            finger.cells.astype(np.int32),
            finger.tissue.astype(np.int32),
            self._point.simulation.state.translation_old.value.copy(),
            self._point.body,
        )
