"""Firing of afferents under vibration: means over afferents that have adapted to the hold.

A receptor's spectrum gives what it feels at any amplitude, so that rates follow in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from tactile_fem import Population
from tactile_fem.neuron import Drive, drive_of
from tactile_fem.neuron.transduction import Varied, held, transduction_of
from tactile_fem.study import Neuron
from tactile_fem.vibration import Spectrum

Array = NDArray[Any]
FEELS = {"SA1": "sed", "RA": "compression", "PC": "indentation"}
_HELD_S = 60.0  # before the vibration
# Spikes are counted over whole cycles, at least so many and so long, after others.
_SETTLING, _COUNTING = (2, 0.25), (4, 1.0)
_GAINS, _THRESHOLDS = 11, 7  # quantiles
_FELT = Drive("Felt", "1", lambda histories: histories["felt"])


def quantiles(spread: float, count: int) -> Array:
    """Return factors that are equally probable if their logarithm has a standard deviation."""
    return np.exp(spread * norm.ppf((np.arange(count) + 0.5) / count)) if spread else np.ones(1)


def spikes(neuron: Neuron, time_s: Array, felt: Array, thresholds: ArrayLike = 1.0) -> list[Array]:
    """Return the spikes of single afferents, with neither spread, for each column of `felt`.

    `thresholds` are factors, one or (columns,).
    """
    median = neuron.model_copy(update={"gain_spread": 0.0, "threshold_spread": 0.0})
    adapted = held(transduction_of(median), _HELD_S)
    each = np.broadcast_to(thresholds, felt.shape[1])
    raised = Varied(adapted, each, np.zeros(felt.shape[1]))
    return Population("one", median, _FELT, raised).fire({"time_s": time_s, "felt": felt}).spikes


@dataclass(frozen=True)
class Site:
    """A place of the skin under a probe that vibrates, and the kind of afferent there.

    Attributes
    ----------
    spectrum
        What receptors feel.
    kind
        Of the afferents.
    place
        Number of the receptor among those of the kind.
    """

    spectrum: Spectrum
    kind: str
    place: int = 0

    @property
    def receptor(self) -> int:
        """Its number in the spectrum."""
        return int(np.flatnonzero(self.spectrum.population == self.kind)[self.place])

    def number(self, frequency_Hz: float) -> int:
        """Return the number of a frequency in the spectrum."""
        return int(np.flatnonzero(self.spectrum.frequency_Hz == frequency_Hz)[0])

    def felt_per_mm(self) -> Array:
        """Return the amplitude of the drive for small vibrations, per mm, over the frequency."""
        s, r = self.spectrum, self.receptor
        felt = {"SA1": s.sed_kPa[:, r], "RA": s.stretches[:, r, 0], "PC": s.moved[:, r, 2]}
        return np.abs(felt[self.kind])

    def felt(
        self, frequency_Hz: float, amplitudes_um: ArrayLike, duration_s: float
    ) -> tuple[Array, Array]:
        """Return times, s, and the drive, (t, amplitudes)."""
        amplitudes_mm = np.asarray(amplitudes_um, dtype=float) / 1000
        own = self.spectrum.at_amplitudes(self.receptor, amplitudes_mm)
        return drive_of(FEELS[self.kind]).of(
            own.histories(self.number(frequency_Hz), 1.0, duration_s)
        )

    def cycles_of_one(
        self,
        neuron: Neuron,
        frequency_Hz: float,
        amplitudes_um: ArrayLike,
        gains: ArrayLike = 1.0,
        thresholds: ArrayLike = 1.0,
    ) -> Array:
        """Return the spikes per cycle of single afferents, (amplitudes,).

        `gains` are factors of the drive, `thresholds` of the threshold; one or (amplitudes,).
        """
        f = frequency_Hz
        settling, counted = (max(n, np.ceil(f * s)) for n, s in (_SETTLING, _COUNTING))
        time_s, felt = self.felt(f, amplitudes_um, (settling + counted) / f)
        fired = spikes(neuron, time_s, felt * np.asarray(gains), thresholds)
        return np.array([np.sum(times > settling / f) for times in fired]) / counted

    def cycles(self, neuron: Neuron, frequency_Hz: float, amplitudes_um: ArrayLike) -> Array:
        """Return the mean spikes per cycle of afferents with both spreads, (amplitudes,)."""
        gains = quantiles(neuron.gain_spread, _GAINS)
        thresholds = quantiles(neuron.threshold_spread, _THRESHOLDS)
        each = np.meshgrid(amplitudes_um, gains, thresholds, indexing="ij")
        columns = [values.ravel() for values in each]
        return (
            self.cycles_of_one(neuron, frequency_Hz, *columns).reshape(each[0].shape).mean((1, 2))
        )
