"""Firing of afferents under vibration: means over afferents that have adapted to the hold.

A receptor's spectrum gives what it feels at any amplitude, so that rates follow in seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from tactile_fem import Population
from tactile_fem.neuron import Drive, Segment, drive_of
from tactile_fem.neuron.transduction import transduction_of
from tactile_fem.study import Neuron
from tactile_fem.vibration import Spectrum

Array = NDArray[Any]
FEELS = {"SA1": "sed", "RA": "compression", "PC": "indentation"}
HELD_S = 60.0  # before the vibration
# Spikes are counted over whole cycles, at least so many and so long, after others.
_SETTLING, _COUNTING = (2, 0.25), (4, 1.0)
_GAINS, _THRESHOLDS = 11, 7  # quantiles
_FELT = Drive("Felt", "1", lambda histories: histories["felt"])


class Held:
    """Transduction of afferents that have met the first value of the drive for `HELD_S` before.

    Their membranes are at rest when the history begins.
    """

    def __init__(self, neuron: Neuron) -> None:
        self._own = transduction_of(neuron)

    def segments(self, time_s: Array, drive: Array) -> Iterator[Segment]:
        """Yield the current of the history, without the hold."""
        time = np.append(time_s[0] - HELD_S, time_s)
        for segment in self._own.segments(time, np.vstack([drive[:1], drive])):
            if np.min(segment.start_s) >= time_s[0]:
                yield segment


def quantiles(count: int) -> Array:
    """Return the middles of equally probable parts of the normal distribution."""
    return norm.ppf((np.arange(count) + 0.5) / count)


def spikes(neuron: Neuron, time_s: Array, felt: Array) -> list[Array]:
    """Return the spikes of single afferents, with neither spread, for each column of `felt`."""
    median = neuron.model_copy(update={"gain_spread": 0.0})
    # A band-pass has always met the first value.
    transduction = None if neuron.model == "band_pass" else Held(median)
    fired = Population("one", median, _FELT, transduction).fire({"time_s": time_s, "felt": felt})
    return fired.spikes


def thresholds(neuron: Neuron) -> list[Neuron]:
    """Return afferents of equally probable thresholds."""
    spread = getattr(neuron, "threshold_spread", 0.0)
    if not spread:
        return [neuron]
    factors = np.exp(spread * quantiles(_THRESHOLDS))
    changes = [
        {"threshold_mV": neuron.threshold_mV * factor, "threshold_spread": 0.0}
        for factor in factors.tolist()
    ]
    return [neuron.model_copy(update=change) for change in changes]


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
        self, neuron: Neuron, frequency_Hz: float, amplitudes_um: ArrayLike, gains: ArrayLike = 1.0
    ) -> Array:
        """Return the spikes per cycle of single afferents, (amplitudes,).

        `gains` are factors of the drive, one or (amplitudes,).
        """
        f = frequency_Hz
        settling, counted = (max(n, np.ceil(f * s)) for n, s in (_SETTLING, _COUNTING))
        time_s, felt = self.felt(f, amplitudes_um, (settling + counted) / f)
        fired = spikes(neuron, time_s, felt * np.asarray(gains))
        return np.array([np.sum(times > settling / f) for times in fired]) / counted

    def cycles(self, neuron: Neuron, frequency_Hz: float, amplitudes_um: ArrayLike) -> Array:
        """Return the mean spikes per cycle of afferents with both spreads, (amplitudes,)."""
        gains = np.exp(neuron.gain_spread * quantiles(_GAINS)) if neuron.gain_spread else np.ones(1)
        amplitudes = np.asarray(amplitudes_um, dtype=float)
        each, gain = np.repeat(amplitudes, len(gains)), np.tile(gains, len(amplitudes))
        of_one = [self.cycles_of_one(one, frequency_Hz, each, gain) for one in thresholds(neuron)]
        return np.mean(of_one, axis=0).reshape(len(amplitudes), -1).mean(axis=1)
