"""What differs between afferents and from spike to spike, the same for any grouping of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
_GAINS, _DISTANCES = 0, 1
_BLOCK = 64


class Variability:
    """Log-normal factors of the gains and of the distances from reset to threshold.

    Each afferent has a stream of random numbers of its own, found from the seed and its number
    (a counter-based generator), so its spikes do not depend on who else is computed.

    Parameters
    ----------
    neuron
        Its `gain_spread`, `threshold_noise` and `seed`.
    units
        The afferents' numbers, (n,).
    """

    def __init__(self, neuron: Neuron, units: NDArray[np.int64]) -> None:
        self._gain_spread, self._noise = neuron.gain_spread, neuron.threshold_noise
        self._seed, self._units = neuron.seed, units
        self._used = np.zeros(len(units), dtype=np.int64)
        self._normal = np.zeros((len(units), 0))

    def gains(self) -> Array:
        """Return the factor of each afferent's gains, median 1, (n,)."""
        if not self._gain_spread:
            return np.ones(len(self._units))
        first = [self._draw(_GAINS, unit, 0)[0] for unit in self._units.tolist()]
        return np.exp(self._gain_spread * np.array(first))

    @property
    def count(self) -> int:
        """Number of afferents."""
        return len(self._units)

    def after_spike(self, which: Array) -> Array:
        """Return the next factors of the distances of some, median 1, without repetition."""
        if not self._noise:
            return np.ones(len(which))
        if not self._normal.size:
            self._normal = np.zeros((len(self._units), _BLOCK))
        place = self._used[which] % _BLOCK
        for k in which[place == 0].tolist():
            block = int(self._used[k]) // _BLOCK
            self._normal[k] = self._draw(_DISTANCES, int(self._units[k]), block)
        self._used[which] += 1
        return np.exp(self._noise * self._normal[which, place])

    def _draw(self, purpose: int, unit: int, block: int) -> Array:
        stream = np.random.Philox(key=[self._seed, purpose], counter=[0, 0, block, unit])
        return np.random.Generator(stream).standard_normal(_BLOCK)
