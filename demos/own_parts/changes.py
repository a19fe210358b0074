"""A transduction that responds to changes in both directions, as rapidly adapting afferents do."""

from dataclasses import dataclass

import numpy as np

from tactile_fem.neuron import ExponentialSum, Segment


@dataclass(frozen=True)
class Changes:
    """I = gain |dS/dt|, with the gain in pA s per unit of the drive S."""

    gain: float

    def segments(self, time_s, drive):
        """Yield the current of each step, in pA."""
        for k, h in enumerate(np.diff(time_s)):
            current = self.gain * np.abs(drive[k + 1] - drive[k]) / h
            no_exponentials = np.empty((0, len(current))), np.empty(0)
            yield Segment(time_s[k], h, ExponentialSum(current, 0 * current, *no_exponentials))
