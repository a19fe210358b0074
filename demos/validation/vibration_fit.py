"""Fits of RA and PC: filters to the shape of thresholds, the rest to rates at one frequency.

**Filters.** At a threshold the largest potential that a sine evokes is that of the membrane's
threshold: the amplitude of the probe is inversely proportional to what the finger makes of it, to
``|H|`` and to what the membrane passes of the rectified sine. The level is free.

**Rates.** Measured ones are means over afferents, whose gains differ. A gain is a factor of the
amplitude, so the rates of one afferent over the amplitude give those of any gain and any spread.
Membrane, refractoriness and the share of the other direction are the best of some values, tried one
after the other. RA have also to follow the entrainment of one afferent, whose gain is free.
Deviations are in spikes per cycle, those of thresholds are logarithms.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from vibration_firing import Site, quantiles
from vibration_measured import ENTRAINMENT, ENTRAINMENT_HZ, RATES, THRESHOLDS_UM

from tactile_fem.study import Neuron

Array = NDArray[Any]
FITTED_HZ = {"RA": 50.0, "PC": 100.0}
# What is tried, one constant after the other; a raised threshold is relative refractoriness.
_TRIED: dict[str, dict[str, tuple[float, ...]]] = {
    "RA": {
        "threshold_jump_mV": (0.0, 240.0, 480.0, 600.0, 720.0, 960.0),
        "threshold_recovery_s": (0.002, 0.004, 0.005, 0.006, 0.008, 0.012),
        "capacitance_pF": (0.3, 0.6, 1.2, 3.0, 6.0, 12.0),
        "refractory_s": (0.001, 0.0015, 0.002, 0.004),  # the default is 0.003, see there
        "filter_off": (0.0, 0.1, 0.2, 0.3, 0.4),
    },
    "PC": {
        "threshold_jump_mV": (0.0, 240.0, 480.0, 960.0, 1920.0),
        "threshold_recovery_s": (0.002, 0.004, 0.006, 0.008),
        "capacitance_pF": (0.3, 0.6, 0.9, 1.8),
        "refractory_s": (0.001, 0.002, 0.003),
    },
}
# Weaker vibration evokes spikes in some of the cycles, by noise that the model does not have.
ENTRAINED_UM = 28.0
# Wider spreads fit hardly better.
_GAINS, _SPREADS = np.geomspace(0.02, 20, 160), np.linspace(0.0, 0.9, 10)
_PER_PERIOD = 1024  # samples of a rectified sine


def gain_of_filter(f: Array, neuron: Neuron) -> Array:
    """Return ``|H|`` of the band-pass at frequencies, see `tactile_fem.neuron.transduction`."""
    x = f / neuron.filter_centre_Hz
    return (1 + (neuron.filter_quality * (x - 1 / x)) ** 2) ** (-neuron.filter_order / 2)


def passed_by_membrane(f: float, neuron: Neuron) -> float:
    """Return the largest potential, per V of the limit, under a rectified sine of amplitude 1."""
    sine = np.sin(2 * np.pi * (np.arange(_PER_PERIOD) + 0.5) / _PER_PERIOD)
    rectified = np.maximum(sine, 0.0) + neuron.filter_off * np.maximum(-sine, 0.0)
    waves = np.fft.rfft(rectified)
    w = 2 * np.pi * f * np.arange(len(waves))
    return float(np.fft.irfft(waves / (1 + 1j * w * neuron.time_constant_s)).max())


def thresholds_of(site: Site, neuron: Neuron) -> Array:
    """Return the shape of the threshold at each frequency: its level is arbitrary."""
    f = site.spectrum.frequency_Hz
    passed = np.array([passed_by_membrane(one, neuron) for one in f.tolist()])
    return 1 / (passed * gain_of_filter(f, neuron) * site.felt_per_mm())


def with_filter(site: Site, neuron: Neuron) -> tuple[Neuron, float]:
    """Return the neuron with its filter fitted to thresholds, and the mean square deviation."""
    measured, f = THRESHOLDS_UM[site.kind], site.spectrum.frequency_Hz
    where = np.isin(f, list(measured))
    wanted = np.log([measured[one] for one in f[where]])

    def changed(x: Array) -> Neuron:
        centre, quality = np.exp(x).tolist()
        return neuron.model_copy(update={"filter_centre_Hz": centre, "filter_quality": quality})

    def misfit(x: Array) -> Array:
        away = np.log(thresholds_of(site, changed(x))[where]) - wanted
        return away - away.mean()

    start = np.log([neuron.filter_centre_Hz, neuron.filter_quality])
    found = least_squares(misfit, start, bounds=(start - 2, start + 2))
    return changed(found.x), float(np.mean(found.fun**2))


def with_rates(site: Site, neuron: Neuron, rounds: int) -> Neuron:
    """Return the neuron with the constants that fit thresholds and rates best.

    All are tried in each round; without rounds, only filter, gain and spread are fitted.
    """
    best, least = with_gain(site, neuron)
    for _ in range(rounds):
        before = least
        for name, values in _TRIED[site.kind].items():
            for value in values:
                if value == getattr(best, name):
                    continue
                one, away = with_gain(site, best.model_copy(update={name: value}))
                if away < least:
                    best, least = one, away
        if least == before:
            break
    print(f"{site.kind}: deviation {np.sqrt(least):.3f}")
    return best


def with_gain(site: Site, neuron: Neuron) -> tuple[Neuron, float]:
    """Return the neuron with its best filter, gain and spread, and the mean square deviation."""
    frequency = FITTED_HZ[site.kind]
    amplitudes, rates = np.array(RATES[site.kind][frequency]).T
    levels = np.geomspace(amplitudes[0] / 30, amplitudes[-1] * 100, 60)
    one, of_filter = with_filter(site, neuron)
    one = one.model_copy(update={"filter_gain_pA": rheobase_gain(site, one)})
    cycles = site.cycles_of_one(one, frequency, levels)
    of_rates, factor, spread = of_means(levels, cycles, amplitudes, rates / frequency)
    away = of_filter + of_rates
    if site.kind == "RA":
        away += of_one(levels, site.cycles_of_one(one, ENTRAINMENT_HZ, levels))[0]
    found = {"filter_gain_pA": factor * one.filter_gain_pA, "gain_spread": spread}
    return one.model_copy(update=found), away


def of_means(
    levels: Array, cycles: Array, amplitudes: Array, measured: Array
) -> tuple[float, float, float]:
    """Return mean square deviation, factor of the gain and its spread of the best means."""
    best = np.inf, 1.0, 0.0
    for spread in _SPREADS:
        each = _GAINS[:, None, None] * amplitudes[:, None] * quantiles(spread, 11)
        mean = np.interp(np.log(each), np.log(levels), cycles).mean(axis=-1)
        away = ((mean - measured) ** 2).mean(axis=1)
        k = int(away.argmin())
        best = min(best, (float(away[k]), float(_GAINS[k]), float(spread)))
    return best


def of_one(levels: Array, cycles: Array) -> tuple[float, float, Array]:
    """Return mean square deviation, factor of the gain and cycles of the entrained afferent."""
    amplitudes, measured = np.array(ENTRAINMENT).T
    found = np.interp(np.log(np.outer(_GAINS, amplitudes)), np.log(levels), cycles)
    away = ((found - measured)[:, amplitudes >= ENTRAINED_UM] ** 2).mean(axis=1)
    k = int(away.argmin())
    return float(away[k]), float(_GAINS[k]), found[k]


def rheobase_gain(site: Site, neuron: Neuron) -> float:
    """Return the gain with which the least amplitude that fired brings the rheobase."""
    frequency = FITTED_HZ[site.kind]
    k = site.number(frequency)
    felt = RATES[site.kind][frequency][0][0] / 1000 * site.felt_per_mm()[k]
    H = gain_of_filter(site.spectrum.frequency_Hz, neuron)[k]
    return float(neuron.threshold_mV / neuron.resistance_GOhm / (felt * H))
