"""Keeps the finger's shape while `tactile_fem.vibration.run.vibrate` goes through frequencies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray

from tactile_fem.finger import FingerMesh
from tactile_fem.vibration.harmonic import Response
from tactile_fem.vibration.modes import Modes
from tactile_fem.vibration.run import About

Array = NDArray[Any]


@dataclass
class ModeKeeper:
    """An observer of `vibrate` that keeps the displacement of all nodes.

    Parameters
    ----------
    frequencies_Hz
        Those at which it is kept, equal to some that are computed.
    """

    frequencies_Hz: ArrayLike
    _kept: list[tuple[float, Array]] = field(default_factory=list)
    _about: tuple[About, Array] | None = None

    def __call__(self, about: About, response: Response) -> None:
        """Keep the displacement if it is wanted at this frequency; all ranks call."""
        if response.frequency_Hz not in np.asarray(self.frequencies_Hz):
            return
        if self._about is None:
            problem = about.simulation.problem
            self._about = about, problem.order.gather(problem.u).astype(np.float32)
        self._kept.append((response.frequency_Hz, _everywhere(about, response)))

    def modes(self) -> Modes | None:
        """Return what was kept, on the first rank; None on the others or if there is nothing."""
        if self._about is None:
            return None
        about, still = self._about
        finger: FingerMesh | None = about.simulation.finger
        if finger is None:
            return None
        frequencies, moved = zip(*self._kept, strict=True)
        return Modes(
            np.array(frequencies),
            np.array(moved),
            still,
            finger.nodes.astype(np.float32),
            finger.cells.astype(np.int32),
            finger.tissue.astype(np.int32),
            about.simulation.state.translation_old.value.copy(),
            about.body,
        )


def _everywhere(about: About, response: Response) -> Array:
    """Return the displacement of all nodes, (n, 3); rigid tissues outside the space go along."""
    problem = about.simulation.problem
    values = fem.Function(problem.u.function_space)

    def gathered(of_space: ArrayLike) -> Array:
        values.x.array[:] = of_space
        return problem.order.gather(values)

    inside = gathered(1.0) != 0
    found = gathered(response.u.real) + 1j * gathered(response.u.imag)
    return np.where(inside, found, about.bone).astype(np.complex64)
