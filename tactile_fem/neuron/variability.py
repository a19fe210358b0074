"""Random variability, reproducible for any subset of afferents."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
_GAINS, _DISTANCES = 0, 1  # keys of the streams
_BLOCK = 64  # numbers drawn at a time


class Variability:
    """Log-normal factors of the gains and of the distances from reset to threshold.

    Each afferent has its own stream of random numbers, which follows from the seed and the
    afferent's number (a counter-based generator): spikes do not depend on the other afferents.

    Parameters
    ----------
    neuron
        Its `gain_spread`, `threshold_noise` and `seed`.
    units
        The afferents' numbers, (n,).
    """

    def __init__(self, neuron: Neuron, units: NDArray[np.int64]) -> None:
        self._neuron, self._units = neuron, units
        self.count = len(units)
        self._used = np.zeros(self.count, dtype=np.int64)
        self._normal = np.zeros((self.count, _BLOCK if neuron.threshold_noise else 0))

    def gains(self) -> Array:
        """Return the factor of each afferent's gains, median 1, (n,)."""
        first = [self._draw(_GAINS, unit, 0)[0] for unit in self._units.tolist()]
        return np.exp(self._neuron.gain_spread * np.array(first))

    def after_spike(self, which: Array) -> Array:
        """Return the next factors of the distances of some, median 1, without repetition."""
        if not self._neuron.threshold_noise:
            return np.ones(len(which))
        place = self._used[which] % _BLOCK
        for k in which[place == 0].tolist():
            block = int(self._used[k]) // _BLOCK
            self._normal[k] = self._draw(_DISTANCES, int(self._units[k]), block)
        self._used[which] += 1
        return np.exp(self._neuron.threshold_noise * self._normal[which, place])

    def _draw(self, purpose: int, unit: int, block: int) -> Array:
        key = [self._neuron.seed, purpose]
        stream = np.random.Philox(key=key, counter=[0, 0, block, unit])
        return np.random.Generator(stream).standard_normal(_BLOCK)
