"""Human afferents: the model's law with a gain and a threshold of their own."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import recordings
from recordings import Array, rates_of

from tactile_fem.neuron import Drive, FitWarning, fit, modelled_rates
from tactile_fem.study import Neuron


@dataclass(frozen=True)
class HumanAfferent:
    """A human afferent: gain and threshold relative to the model's, rates, (2, depths)."""

    name: str
    gain: float
    threshold: float
    model_Hz: Array
    measured_Hz: Array

    @classmethod
    def of(cls, drive: Drive, neuron: Neuron, name: str, radius_mm: float) -> HumanAfferent:
        """Fit gain and threshold of unit "b" to ramp and hold, those of "a" to its hold."""
        unit = recordings.human_unit(drive, name, radius_mm)
        late = [one._replace(windows=one.windows[1:]) for one in unit]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FitWarning)  # one alone hardly determines both
            found = fit(unit if name == "b" else late, neuron, ())
        gain, threshold = (e.value for e in found.estimates.values())
        model = np.hstack([modelled_rates(one, neuron, gain, threshold) for one in unit])
        return cls(name, gain, threshold, model, rates_of(unit).reshape(-1, 2).T)

    @property
    def told(self) -> str:
        """What it is, in words."""
        return f"human {self.name} (gain {self.gain:.2g}, threshold {self.threshold:.2g})"
