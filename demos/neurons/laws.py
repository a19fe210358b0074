"""Laws of transduction that are fitted to recordings, and the agreement that they reach."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import recordings
from recordings import Array

from tactile_fem.neuron import Drive, FitWarning, RateFit, Recording, fit, mean_rates
from tactile_fem.runtime.estimates import r_squared
from tactile_fem.study import Neuron


@dataclass(frozen=True)
class Law:
    """A model of transduction, where its fit starts and which constants are free."""

    neuron: Neuron
    free: tuple[str, ...]

    def fitted(self, some: Sequence[Recording]) -> RateFit:
        """Fit the free constants."""
        return fit(some, self.neuron, self.free)

    def fitted_quietly(self, some: Sequence[Recording]) -> tuple[RateFit, int]:
        """Return a fit, and how many constants it warns of."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", FitWarning)
            return self.fitted(some), len(caught)

    def with_free(self, name: str) -> Law:
        """Return the law with one more free constant."""
        return Law(self.neuron, (*self.free, name))


LAWS = {
    "logarithmic": Law(
        Neuron(model="logarithmic"),
        ("static_gain_pA_per_kPa", "compression_kPa", "fast_adaptation"),
    ),
    "hamasaki2020": Law(
        Neuron(model="hamasaki2020"), ("static_gain_pA_per_kPa", "dynamic_gain_pA_s_per_kPa")
    ),
    "gerling2018": Law(
        Neuron(model="gerling2018"), tuple(f"generator_gains_pA_per_kPa[{k}]" for k in range(4))
    ),
}


def calibrating(drive: Drive, *, spheres: bool = True) -> list[Recording]:
    """Return what is fitted: the bar, and the spheres."""
    return [recordings.bar(drive), *(recordings.spheres(drive) if spheres else ())]


def modelled(some: Sequence[Recording], neuron: Neuron) -> Array:
    """Return the model's mean rates in all windows, one after another, spikes/s."""
    each = (mean_rates(r.time_s, r.drive, r.windows, neuron).ravel() for r in some)
    return np.concatenate(list(each))


def rates_of(some: Sequence[Recording]) -> Array:
    """Return the measured rates in all windows, one after another, spikes/s."""
    return np.concatenate([window.rate_Hz for r in some for window in r.windows])


def explained(some: Sequence[Recording], neuron: Neuron) -> float:
    """Return the share of the variance of the measured rates that the model explains."""
    rates = rates_of(some)
    return r_squared(modelled(some, neuron), rates)
