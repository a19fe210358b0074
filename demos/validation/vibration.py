# %% [markdown]
# # Responses of RA and PC afferents to vibration, fitted and predicted
#
# A probe of 1 mm is pressed in and held, and the finger vibrates about this state. Rates are those
# of monkeys' afferents under such a probe (Muniak et al. 2007, PMC6673240; third-party
# digitization), thresholds of the same kind of recording, of which the shape alone counts. Centre
# and quality of the filters are fitted to the shape of the thresholds; gain, its spread between
# afferents, refractoriness and the raised threshold of PC to the rates at one frequency. They are
# the defaults of RA and PC; the other frequencies are predicted.
#
#     python demos/validation/vibration.py results/vibration
#     python demos/validation/vibration.py results/quick --pad-size 3 --far-size 6 --depth 0.3

# %%
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from tactile_fem import Population, Study, completed, run_script, vibrate, write_table
from tactile_fem.study import Dots, Finger, Hold, Neuron, Press, Protocol, Tissue
from tactile_fem.vibration import Spectrum

# Amplitudes in µm and spikes/s, by kind and frequency in Hz.
RATES: dict[str, dict[float, list[tuple[float, float]]]] = {
    "SA1": {
        20: [(49, 4), (92, 10), (183, 18), (251, 25)],
        50: [(77, 6), (168, 30), (251, 48)],
    },
    "RA": {
        20: [(24, 4), (67, 24), (251, 53)],
        50: [(16, 3), (36, 23), (77, 57), (251, 103)],
        100: [(15, 6), (36, 41), (82, 111), (194, 159)],
    },
    "PC": {
        50: [(4.8, 16), (11, 32), (24, 47), (50, 74), (248, 100)],
        100: [(0.8, 16), (1.8, 41), (4.3, 76), (10, 100), (54, 137)],
        300: [(0.17, 18), (0.43, 62), (1.1, 112), (2.9, 170), (7.5, 238)],
    },
}
THRESHOLDS_UM = {
    "RA": {1: 507, 4: 128, 16: 53, 33: 47, 67: 55},
    "PC": {20: 6.0, 41: 1.4, 82: 0.32, 153: 0.087, 250: 0.052, 422: 0.054, 822: 0.19},
}
FREE_OF_FILTER = {"RA": 1, "PC": 2}  # the centre; the quality as well
FITTED_HZ = {"RA": 50.0, "PC": 100.0}
REFRACTORY_S = {"RA": (0.003, 0.006, 0.009), "PC": (0.001, 0.002, 0.003)}
# Relative refractoriness of PC: what a spike raises the threshold of 30 mV by, and for how long.
# RA's rates are met without.
JUMPS_MV = {"RA": (0.0,), "PC": (0.0, 240.0, 480.0, 960.0, 1920.0)}
RECOVERIES_S = (0.002, 0.004, 0.008)
# Weights of the other direction. RA's is proposed, so that it answers to a release as well; the
# rates do not tell it. PC's filter swings both ways at any change.
OFF = {"RA": 0.4, "PC": 0.0}
QUANTILES = norm.ppf((np.arange(11) + 0.5) / 11)
NOISE = 0.1  # of the threshold, from spike to spike: proposed


@dataclass(frozen=True)
class Row:
    """A measured rate beside the model's."""

    kind: str
    frequency_Hz: float
    amplitude_um: float
    measured_Hz: float
    model_Hz: float
    fitted: bool


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    depth: float = 1.0,
    hold: float = 2.0,
) -> None:
    """Press the probe, let it vibrate, fit the filters and print what is predicted.

    Parameters
    ----------
    folder
        For the scan and the table.
    preset, pad_size, far_size
        The mesh.
    depth, hold
        Of the probe, mm, and how long it is held before, s.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    study = probed(finger, depth, hold)
    completed(study, folder / "scan")
    spectrum = computed(folder)
    populations = {each.name: each.population() for each in study.populations}
    fitted = {"SA1": populations["SA1"].neuron}
    for kind in THRESHOLDS_UM:
        neuron = with_filter(spectrum, kind, populations[kind].neuron)
        fitted[kind] = with_rates(spectrum, kind, neuron)
    rows = [row for kind, neuron in fitted.items() for row in compared(spectrum, kind, neuron)]
    print_rows(rows)
    for kind in THRESHOLDS_UM:
        print_thresholds(spectrum, kind, fitted[kind])
    write_table(folder / "rates.csv", rows)


# %% [markdown]
# A flat-ended probe is a dot so high that its plate does not touch. The skin relaxes, so that a
# short time at rest gives nearly the long-term state and vibration meets the instantaneous one.


# %%
def probed(finger: Finger, depth: float, hold: float) -> Study:
    """Return a study of a probe of 1 mm with one afferent of each kind under its middle."""
    below = {"placement": "line", "half_width_mm": 0.0}
    return Study.model_validate(
        {
            "finger": finger,
            "tissue": Tissue(relaxation="fingerpad"),
            "stimulus": Dots(
                radius_mm=0.5,
                columns=1,
                rows=1,
                relief_mm=4.0,
                fillet_radius_mm=0.1,
                start_mm=0.0,
            ),
            "protocol": Protocol(path=(Press(depth_mm=depth), Hold(time_s=hold))),
            "afferents": [
                {"name": kind, "kind": kind, "receptors": below} for kind in ("SA1", "RA", "PC")
            ],
            "output": {"pictures": False},
        }
    )


def computed(folder: Path) -> Spectrum:
    """Return the vibration of the folder's scan, computed only once."""
    wanted, path = sorted(frequencies()), folder / "spectrum.npz"
    if path.exists() and list(Spectrum.load(path).frequency_Hz) == wanted:
        return Spectrum.load(path)
    spectrum = vibrate(folder / "scan", wanted)
    spectrum.save(path)
    return spectrum


def frequencies() -> set[float]:
    """Return all frequencies at which there is a measured value, Hz."""
    found = {float(f) for of_kind in RATES.values() for f in of_kind}
    return found | {float(f) for of_kind in THRESHOLDS_UM.values() for f in of_kind}


def receptor_of(spectrum: Spectrum, kind: str) -> int:
    """Return the one receptor of a kind."""
    return int(np.flatnonzero(spectrum.population == kind)[0])


def felt_per_mm(spectrum: Spectrum, kind: str) -> np.ndarray:
    """Return the amplitude of what RA or PC feel per mm of the probe's, over the frequency."""
    r = receptor_of(spectrum, kind)
    felt = spectrum.stretches[:, r, 0] if kind == "RA" else spectrum.moved[:, r, 2]
    return np.abs(felt)


# %% [markdown]
# **Filters.** A threshold is inversely proportional to ``|H|`` times what the finger makes of the
# probe's motion there. The level is free. RA's thresholds do not rise within the measured band, so
# the quality of their filter is not determined and stays at 0.5, two equal real poles.


# %%
def gain_of_filter(f: np.ndarray, centre: float, quality: float, order: int) -> np.ndarray:
    """Return ``|H|`` of the band-pass at frequencies, see `tactile_fem.neuron.transduction`."""
    x = f / centre
    return (1 + (quality * (x - 1 / x)) ** 2) ** (-order / 2)


def thresholds_of(spectrum: Spectrum, kind: str, neuron: Neuron) -> np.ndarray:
    """Return the shape of the threshold at each frequency: its level is arbitrary."""
    H = gain_of_filter(
        spectrum.frequency_Hz,
        neuron.filter_centre_Hz,
        neuron.filter_quality,
        neuron.filter_order,
    )
    membrane = np.hypot(1.0, 2 * np.pi * spectrum.frequency_Hz * neuron.time_constant_s)
    return membrane / (H * felt_per_mm(spectrum, kind))


def with_filter(spectrum: Spectrum, kind: str, neuron: Neuron) -> Neuron:
    """Return the neuron with its filter fitted to the shape of measured thresholds."""
    measured = THRESHOLDS_UM[kind]
    where = np.isin(spectrum.frequency_Hz, list(measured))
    wanted = np.log([measured[f] for f in spectrum.frequency_Hz[where]])

    def changed(x: np.ndarray) -> Neuron:
        names = "filter_centre_Hz", "filter_quality"
        return neuron.model_copy(update=dict(zip(names, np.exp(x), strict=False)))

    def misfit(x: np.ndarray) -> np.ndarray:
        away = np.log(thresholds_of(spectrum, kind, changed(x))[where]) - wanted
        return away - away.mean()

    start = np.log([neuron.filter_centre_Hz, neuron.filter_quality][: FREE_OF_FILTER[kind]])
    found = changed(least_squares(misfit, start, bounds=(start - 2, start + 2)).x)
    print(
        f"{kind}: f_0 {found.filter_centre_Hz:.0f} Hz, Q {found.filter_quality:.2f}, "
        f"{found.filter_order} stages (thresholds)"
    )
    return found


# %% [markdown]
# **Rates.** Measured ones are means over afferents, whose gains differ. A gain is a factor of the
# amplitude, so the rates of one afferent over the amplitude give those of any gain and any spread.


# %%
def rates_of(
    spectrum: Spectrum, kind: str, neuron: Neuron, frequency: float, amplitudes_um: Sequence[float]
) -> np.ndarray:
    """Return the mean rates of afferents at several amplitudes, spikes/s."""
    gains = np.exp(neuron.gain_spread * QUANTILES)
    each = np.outer(amplitudes_um, gains)
    return rates_of_one(spectrum, kind, neuron, frequency, each.ravel()).reshape(each.shape).mean(1)


def rates_of_one(
    spectrum: Spectrum, kind: str, neuron: Neuron, frequency: float, amplitudes_um: np.ndarray
) -> np.ndarray:
    """Return the rates of the afferent of median gain, spikes/s."""
    own = spectrum.at_amplitudes(receptor_of(spectrum, kind), amplitudes_um / 1000)
    feels = {"SA1": "sed", "RA": "compression", "PC": "indentation"}[kind]
    k = int(np.flatnonzero(spectrum.frequency_Hz == frequency)[0])
    median = neuron.model_copy(update={"gain_spread": 0.0})
    return own.rates_Hz(k, 1.0, Population(kind, median, feels))


def with_rates(spectrum: Spectrum, kind: str, neuron: Neuron) -> Neuron:
    """Return the neuron with the constants that fit the rates at one frequency best."""
    frequency, start = FITTED_HZ[kind], rheobase_gain(spectrum, kind, neuron)
    amplitudes, measured = map(np.array, zip(*RATES[kind][frequency], strict=True))
    levels = np.geomspace(amplitudes[0] / 30, amplitudes[-1] * 300, 100)
    best, least = neuron, np.inf
    for refractory, (jump, recovery) in product(REFRACTORY_S[kind], raised_thresholds(kind)):
        tried = neuron.model_copy(
            update={
                "filter_gain_pA": start,
                "refractory_s": refractory,
                "threshold_jump_mV": jump,
                "threshold_recovery_s": recovery,
                "filter_off": OFF[kind],
                "threshold_noise": NOISE,
            }
        )
        rates = rates_of_one(spectrum, kind, tried, frequency, levels)
        for factor, spread in product(np.geomspace(0.05, 20, 60), np.linspace(0, 1.5, 16)):
            each = np.outer(factor * amplitudes, np.exp(spread * QUANTILES))
            mean = np.interp(np.log(each), np.log(levels), rates).mean(axis=1)
            away = float(np.sum((mean - measured) ** 2))
            if away < least:
                changes = {"filter_gain_pA": factor * start, "gain_spread": spread}
                best, least = tried.model_copy(update=changes), away
    print(
        f"{kind}: gain {best.filter_gain_pA:.3g} pA per unit, its spread {best.gain_spread:.2g}, "
        f"refractory {1000 * best.refractory_s:g} ms, threshold raised by "
        f"{best.threshold_jump_mV:g} mV for {1000 * best.threshold_recovery_s:g} ms, "
        f"other direction {best.filter_off:g} "
        f"(rates at {frequency:g} Hz)"
    )
    return best


def raised_thresholds(kind: str) -> list[tuple[float, float]]:
    """Return what is tried for jump, mV, and recovery, s, of the threshold."""
    pairs = product(JUMPS_MV[kind], RECOVERIES_S)
    return [(jump, s) for jump, s in pairs if jump or s == RECOVERIES_S[0]]


def rheobase_gain(spectrum: Spectrum, kind: str, neuron: Neuron) -> float:
    """Return the gain with which the least amplitude that fired brings the rheobase."""
    frequency = FITTED_HZ[kind]
    k = int(np.flatnonzero(spectrum.frequency_Hz == frequency)[0])
    felt = RATES[kind][frequency][0][0] / 1000 * felt_per_mm(spectrum, kind)[k]
    H = gain_of_filter(
        spectrum.frequency_Hz, neuron.filter_centre_Hz, neuron.filter_quality, neuron.filter_order
    )
    return float(neuron.threshold_mV / neuron.resistance_GOhm / (felt * H[k]))


def compared(spectrum: Spectrum, kind: str, neuron: Neuron) -> list[Row]:
    """Return measured rates beside the model's."""
    rows = []
    for frequency, pairs in RATES[kind].items():
        amplitudes, measured = map(list, zip(*pairs, strict=True))
        model = rates_of(spectrum, kind, neuron, frequency, amplitudes)
        for amplitude, rate, found in zip(amplitudes, measured, model, strict=True):
            fitted = FITTED_HZ.get(kind) == frequency
            rows.append(Row(kind, frequency, amplitude, rate, float(found), fitted))
    return rows


def print_rows(rows: list[Row]) -> None:
    """Print measured and model's rates, and how far they are apart."""
    for kind in RATES:
        own = [row for row in rows if row.kind == kind]
        for frequency in RATES[kind]:
            there = [row for row in own if row.frequency_Hz == frequency]
            told = ", ".join(
                f"{row.amplitude_um:g} µm {row.measured_Hz:g} {row.model_Hz:.0f}" for row in there
            )
            away = np.array([row.model_Hz - row.measured_Hz for row in there])
            what = "fitted" if there[0].fitted else "predicted"
            rms = np.sqrt(np.mean(away**2))
            print(f"{kind} {frequency:g} Hz, {what}: {told}; rms {rms:.0f} spikes/s")


def print_thresholds(spectrum: Spectrum, kind: str, neuron: Neuron) -> None:
    """Print the shape of the thresholds, with their mean level that of the measured ones."""
    measured = THRESHOLDS_UM[kind]
    shape = dict(zip(spectrum.frequency_Hz, thresholds_of(spectrum, kind, neuron), strict=True))
    away = {f: np.log(shape[f] / value) for f, value in measured.items()}
    level = np.exp(np.mean(list(away.values())))
    told = ", ".join(f"{f} Hz {value:g} {shape[f] / level:.2g}" for f, value in measured.items())
    best = min(shape, key=lambda f: shape[f])
    spread = np.std(list(away.values()))
    print(f"{kind} thresholds, µm (measured, shape): {told}; factor {np.exp(spread):.2f} rms")
    print(f"{kind} best frequency: {best:g} Hz")


if __name__ == "__main__":
    run_script(main)
