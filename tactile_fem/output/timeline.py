"""When the frames of a scan's film are, and what its histories are then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_fem.output.histories import TIME, Abscissa, at_time
from tactile_fem.simulation.results import Results

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Timeline:
    """Frames evenly between the saved states of a scan.

    Attributes
    ----------
    times_s, since_s
        Of the frames and of those before them, (frames,).
    displacement_mm
        (frames,).
    label, along
        What the frames are sorted by, displacement or time, and its values, (frames,).
    """

    times_s: Array
    since_s: Array
    displacement_mm: Array
    label: str
    along: Array

    @classmethod
    def of(cls, results: Results, written_s: Array, between: int) -> Timeline:
        """Return `between` frames from one saved state, at `written_s`, to the next."""
        frames = np.arange(between * (len(written_s) - 1) + 1) / between
        times = np.interp(frames, np.arange(len(written_s)), written_s)
        step = times[1] - times[0] if len(frames) > 1 else np.inf
        since = np.concatenate([times[:1] - step, times[:-1]])
        slid = at_time(results.trace, "displacement_mm", times)
        label = Abscissa.of(results).label
        return cls(times, since, slid, label, times if label == TIME else slid)

    def __len__(self) -> int:
        return len(self.times_s)

    def nearest(self, value: float) -> int:
        """Return the number of the frame nearest to a value of `along`.

        The displacement stays 0 during the indentation: the frame at its end is that of 0.
        """
        apart = np.abs(self.along - value)
        return int(np.flatnonzero(apart == apart.min())[-1])

    def fired(self, results: Results, k: int) -> NDArray[np.bool_]:
        """Return which receptors have fired since the frame before frame `k`."""
        spikes = results.spikes
        recent = (spikes.time_s > self.since_s[k]) & (spikes.time_s <= self.times_s[k])
        return np.isin(np.arange(len(results.trace["receptors_mm"])), spikes.receptor[recent])
