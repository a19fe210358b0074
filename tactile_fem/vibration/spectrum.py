"""A computed vibration over frequency: what receptors feel, how they fire, the finger's shape."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import MOVED, SED, STRETCHES, Population, trial_histories
from tactile_fem.output import Archived
from tactile_fem.runtime.files import write_table

Array = NDArray[Any]
_SAMPLES_PER_PERIOD = 24
# Between samples lines are felt, whose kinks PC would answer to at low frequencies.
_LONGEST_SAMPLE_S = 4e-4
# Afferents have adapted to the state for a minute; membranes settle before spikes are counted.
_HELD_S, _SETTLING_S, _COUNTING_S = 60.0, 0.25, 1.0


@dataclass(frozen=True)
class Spectrum(Archived):
    """What receptors feel of a vibration of 1 mm about a state.

    Attributes
    ----------
    frequency_Hz
        (f,).
    motion
        Direction of the vibration, (3,), a unit vector.
    receptors_mm, population
        (r, 3), (r,).
    moved, sed_kPa, stretches
        Complex amplitudes per mm: displacement (f, r, 3), strain energy density (f, r), principal
        stretches (f, r, 3). The real part of the amplitude times ``exp(i w t)`` is what is felt.
    force_N
        Complex amplitude of the force on the finger per mm, (f, 3).
    still_moved_mm, still_sed_kPa, still_stretches
        What receptors feel at the state itself, (r, 3), (r,), (r, 3).
    """

    frequency_Hz: Array
    motion: Array
    receptors_mm: Array
    population: Array
    moved: Array
    sed_kPa: Array
    stretches: Array
    force_N: Array
    still_moved_mm: Array
    still_sed_kPa: Array
    still_stretches: Array

    def histories(self, k: int, amplitude_mm: float, duration_s: float) -> dict[str, Array]:
        """Return what receptors feel at the k-th frequency from time 0 on, as a trace has it.

        The vibration sets in within one period. Where it would make a strain energy density
        negative, it is too large for the linearization; there it is zero.
        """
        f = float(self.frequency_Hz[k])
        per_period = max(_SAMPLES_PER_PERIOD, int(np.ceil(1 / (f * _LONGEST_SAMPLE_S))))
        count = int(np.ceil(duration_s * f * per_period)) + 1
        time_s = np.arange(count) / (per_period * f)
        swing = amplitude_mm * np.exp(2j * np.pi * f * time_s) * np.minimum(f * time_s, 1.0)

        def felt(still: Array, amplitude: Array) -> Array:
            return still + np.real(np.multiply.outer(swing, amplitude))

        return {
            "time_s": time_s,
            "population": self.population,
            "moved_mm": felt(self.still_moved_mm, self.moved[k]),
            "sed_kPa": np.maximum(felt(self.still_sed_kPa, self.sed_kPa[k]), 0.0),
            "stretches": felt(self.still_stretches, self.stretches[k]),
        }

    def at_amplitudes(self, receptor: int, amplitudes_mm: ArrayLike) -> Spectrum:
        """Return what one receptor feels at several amplitudes, as receptors side by side."""
        factors = np.asarray(amplitudes_mm, dtype=float)
        same = np.full(len(factors), receptor)
        return replace(
            self,
            receptors_mm=self.receptors_mm[same],
            population=self.population[same],
            moved=self.moved[:, same] * factors[:, None],
            sed_kPa=self.sed_kPa[:, same] * factors,
            stretches=self.stretches[:, same] * factors[:, None],
            still_moved_mm=self.still_moved_mm[same],
            still_sed_kPa=self.still_sed_kPa[same],
            still_stretches=self.still_stretches[same],
        )

    def all_rates_Hz(self, populations: Iterable[Population], amplitude_mm: float) -> Array:
        """Return the firing rates of all receptors at all frequencies, (f, r); NaN if `unfelt`."""
        rates = np.zeros((len(self.frequency_Hz), len(self.population)))
        for population in populations:
            own = self.population == population.name
            if unfelt(population):
                rates[:, own] = np.nan
                continue
            for k in range(len(self.frequency_Hz)):
                rates[k, own] = self.rates_Hz(k, amplitude_mm, population)
        return rates

    def rates_Hz(self, k: int, amplitude_mm: float, population: Population) -> Array:
        """Return the firing rates of a population's receptors at the k-th frequency, (own,).

        The afferents have adapted to the state, held for a minute.
        """
        fired = population.held(_HELD_S).fire(
            self.histories(k, amplitude_mm, _SETTLING_S + _COUNTING_S)
        )
        return np.array([np.sum(times > _SETTLING_S) / _COUNTING_S for times in fired.spikes])

    def write_table(self, path: Path, rates_Hz: Array, amplitude_mm: float) -> None:
        """Write amplitude, phase and firing rate of each receptor at each frequency."""
        records = [
            {
                "frequency_Hz": f"{frequency:.6g}",
                "amplitude_mm": f"{amplitude_mm:.6g}",
                "receptor": r,
                "population": name,
                **_polar("sed_kPa", amplitude_mm * self.sed_kPa[k, r]),
                **_polar("smallest_stretch", amplitude_mm * self.stretches[k, r, 0]),
                **_polar("z_mm", amplitude_mm * self.moved[k, r, 2]),
                "rate_Hz": f"{rates_Hz[k, r]:.6g}",
            }
            for k, frequency in enumerate(self.frequency_Hz)
            for r, name in enumerate(self.population)
        ]
        write_table(path, records)


def unfelt(population: Population) -> str:
    """Return why a vibration does not have the drive of a population; empty if it does."""
    try:
        population.drive.of(trial_histories((MOVED, SED, STRETCHES)))
    except StudyError as error:
        return str(error)
    return ""


def _polar(name: str, value: complex) -> dict[str, str]:
    phase = np.degrees(np.angle(value))
    return {name: f"{abs(value):.6g}", f"{name}_phase_deg": f"{phase:.4g}"}


def frequencies_of(text: str, name: str = "frequencies") -> Array:
    """Return the frequencies of ``low:high:count``, evenly spaced in their logarithm, or of a list.

    A StudyError names the text `name`.
    """
    try:
        if ":" in text:
            low, high, count = text.split(":")
            ends, number = (float(low), float(high)), int(count)
            if min(ends) <= 0 or number < 1:
                raise ValueError
            found = np.geomspace(*ends, number)
        else:
            found = np.array([float(word) for word in text.split(",")])
        if not (np.isfinite(found).all() and (found > 0).all()):
            raise ValueError
    except ValueError:
        raise StudyError(
            f'{name} is "{text}" but must be low:high:count or a list such as 10,50,250, '
            "in Hz and greater than 0."
        ) from None
    return found


def few_of(frequencies_Hz: ArrayLike) -> Array:
    """Return the lowest, the middle and the highest frequency: shapes of all nodes are large."""
    rising = np.sort(np.asarray(frequencies_Hz, dtype=float))
    return np.unique(rising[[0, len(rising) // 2, -1]])
