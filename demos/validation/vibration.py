# %% [markdown]
# # Responses of afferents to vibration, fitted and predicted
#
# A probe is pressed in and held, and the finger vibrates about this state. Rates are those of
# monkeys' afferents under a probe of 1 mm (Muniak et al. 2007, PMC6673240; third-party
# digitization), thresholds of the same kind of recording, of which the shape alone counts, and the
# entrainment of one RA afferent (Talbot et al. 1968). Filters are fitted to the shape of the
# thresholds; gain and its spread, membrane and refractoriness to the rates at one frequency, those
# of RA also to the entrainment (`vibration_fit.py`). They are the defaults of RA and PC. Predicted
# are the other frequencies, and humans' spikes per cycle and in ramps.
#
# SA1 have the constants of `calibrate.py`, and have adapted to the hold for a minute.
#
#     python demos/validation/vibration.py results/vibration
#     python demos/validation/vibration.py results/vibration --no-fit  # the defaults: a minute
#     python demos/validation/vibration.py results/quick --pad-size 3 --far-size 6 --depth 0.3

# %%
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from vibration_firing import FEELS, Site, spikes
from vibration_fit import FITTED_HZ, of_one, thresholds_of, with_rates
from vibration_measured import (
    CYCLES,
    CYCLES_DEPTH_MM,
    CYCLES_RADII_MM,
    CYCLES_UM,
    ENTRAINMENT,
    ENTRAINMENT_HZ,
    RAMPS,
    RAMPS_MM,
    RATES,
    THRESHOLDS_UM,
)

from tactile_fem import Results, Study, completed, run_script, vibrate, write_table
from tactile_fem.neuron import drive_of
from tactile_fem.study import Dots, Finger, Hold, Neuron, Press, Protocol, Solver, Tissue
from tactile_fem.vibration import Spectrum

MONKEYS_RADIUS_MM = 0.5
AMPLITUDES_UM = (5.0, 15.0, 50.0, 150.0, 400.0)
# A slow ramp and a fast one feel nearly the same at the same depth: one is pressed.
RAMP_MM_S, RAMP_STEP_MM, RAMP_HOLD_S = 30.0, 0.05, 0.2
RAMP_RADII_MM = (0.5, 1.0, 2.0)


@dataclass(frozen=True)
class Row:
    """A measured response beside the model's."""

    kind: str
    what: str
    frequency_Hz: float
    amplitude_um: float
    measured: float
    model: float
    fitted: bool


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    depth: float = 1.0,
    human_depth: float = CYCLES_DEPTH_MM,
    ramp: float = RAMPS_MM,
    hold: float = 2.0,
    fit: bool = True,
    rounds: int = 3,
    gain_spread: float | None = None,
    threshold_spread: float | None = None,
) -> None:
    """Press probes, let them vibrate, fit RA and PC and print what is predicted.

    Parameters
    ----------
    folder
        Folder for scans, spectra and tables; what it has is not computed again.
    preset, pad_size, far_size
        The mesh.
    depth, human_depth, ramp
        Depth of the probe on monkeys, on humans and in ramps, mm.
    hold
        Duration of the hold before, s, in relaxing tissue.
    fit
        Fit RA and PC; otherwise they have the defaults.
    rounds
        Largest number of rounds of the fit; 0 fits filter, gain and spread only.
    gain_spread, threshold_spread
        Spreads between SA1 afferents, in place of the defaults.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    held = Hold(time_s=hold)
    monkeys = computed(
        folder / "monkeys",
        probed(finger, MONKEYS_RADIUS_MM, (Press(depth_mm=depth), held)),
        {f for of_kind in (*RATES.values(), *THRESHOLDS_UM.values()) for f in of_kind}
        | {ENTRAINMENT_HZ},
    )
    humans = {
        radius: computed(
            folder / f"humans_{radius:g}",
            probed(finger, radius, (Press(depth_mm=human_depth), held), [(0.0, radius)]),
            CYCLES["SA1"],
        )
        for radius in CYCLES_RADII_MM
    }
    ramps = {
        radius: pressed(folder / f"ramp_{radius:g}", finger, radius, ramp)
        for radius in RAMP_RADII_MM
    }
    neurons = defaults()
    spreads = {"gain_spread": gain_spread, "threshold_spread": threshold_spread}
    changes = {name: value for name, value in spreads.items() if value is not None}
    neurons["SA1"] = neurons["SA1"].model_copy(update=changes)
    for kind in THRESHOLDS_UM:
        site = Site(monkeys, kind)
        if fit:
            neurons[kind] = with_rates(site, neurons[kind], rounds)
        print_constants(kind, neurons[kind])
        print_thresholds(site, neurons[kind])
    rows = [row for kind, neuron in neurons.items() for row in rates(Site(monkeys, kind), neuron)]
    rows += entrainment(Site(monkeys, "RA"), neurons["RA"])
    for radius, spectrum in humans.items():
        for kind, neuron in neurons.items():
            rows += cycles(Site(spectrum, kind), neuron, f"radius {radius:g} mm")
    # Under the rim of the narrower probe; the wider one does not touch the skin as far out.
    narrow = min(humans)
    rows += cycles(Site(humans[narrow], "SA1", -1), neurons["SA1"], f"rim, {narrow:g} mm")
    print_amplitudes(monkeys, neurons)
    for radius, history in ramps.items():
        print_ramps(radius, *history, neurons["RA"])
    write_table(folder / "responses.csv", rows)


# %% [markdown]
# A flat-ended probe is a dot so high that its plate does not touch. The skin relaxes, so that a
# short time at rest gives nearly the long-term state and vibration meets the instantaneous one.
# Afferents lie under its middle, and at further places.


# %%
def probed(
    finger: Finger,
    radius: float,
    path: Sequence[Press | Hold],
    places: Sequence[tuple[float, float]] = (),
    **further: object,
) -> Study:
    """Return a study of a probe with one afferent of each kind at each place."""
    below = {"placement": "line", "half_width_mm": 0.0, "extra_mm": places}
    return Study.model_validate(
        {
            "finger": finger,
            "tissue": Tissue(relaxation="fingerpad"),
            "stimulus": Dots(
                radius_mm=radius,
                columns=1,
                rows=1,
                relief_mm=4.0,
                fillet_radius_mm=0.1,
                start_mm=0.0,
            ),
            "protocol": Protocol(path=tuple(path)),
            "afferents": [{"name": kind, "kind": kind, "receptors": below} for kind in FEELS],
            "output": {"pictures": False},
            **further,
        }
    )


def scanned(folder: Path, study: Study) -> Results:
    """Return the scan of the study, computed only once, also if its neurons were others then."""
    there = Results(folder)
    if there.complete:
        parts = "finger", "tissue", "stimulus", "protocol", "solver"
        if all(getattr(there.study, part) == getattr(study, part) for part in parts):
            return there
    return completed(study, folder)


def computed(folder: Path, study: Study, frequencies: Iterable[float]) -> Spectrum:
    """Return the vibration about the end of a study, computed only once."""
    results, path = scanned(folder, study), folder / "spectrum.npz"
    wanted = sorted(float(f) for f in frequencies)
    if path.exists() and set(wanted) <= set(Spectrum.load(path).frequency_Hz.tolist()):
        return Spectrum.load(path)
    spectrum = vibrate(results.folder, wanted)
    spectrum.save(path)
    return spectrum


def pressed(
    folder: Path, finger: Finger, radius: float, depth: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of a press's time, and what RA feel, (t, 1)."""
    press = Press(depth_mm=depth, speed_mm_s=RAMP_MM_S)
    solver = Solver(max_press_step_mm=RAMP_STEP_MM)
    trace = scanned(folder, probed(finger, radius, (press,), solver=solver)).trace
    time_s, felt = drive_of(FEELS["RA"]).of(trace)
    own = felt[:, trace["population"] == "RA"]
    return (time_s - time_s[0]) / (time_s[-1] - time_s[0]), own


def defaults() -> dict[str, Neuron]:
    """Return the present constants of each kind."""
    afferents = Study.model_validate({"afferents": [{"name": k, "kind": k} for k in FEELS]})
    return {one.name: one.population().neuron for one in afferents.populations}


# %%
def rates(site: Site, neuron: Neuron) -> list[Row]:
    """Return and print monkeys' rates, spikes/s."""
    rows = []
    for f, pairs in RATES[site.kind].items():
        amplitudes, measured = zip(*pairs, strict=True)
        model = f * site.cycles(neuron, f, amplitudes)
        fitted = FITTED_HZ.get(site.kind) == f
        found = [
            Row(site.kind, "spikes/s", f, *values, fitted)
            for values in zip(amplitudes, measured, model.tolist(), strict=True)
        ]
        away = np.sqrt(np.mean([(row.model - row.measured) ** 2 for row in found]))
        told = ", ".join(
            f"{row.amplitude_um:g} µm {row.measured:g} {row.model:.0f}" for row in found
        )
        what = "fitted" if fitted else "predicted"
        print(f"{site.kind} {f:g} Hz, {what}: {told}; rms {away:.0f} spikes/s")
        rows += found
    return rows


def entrainment(site: Site, neuron: Neuron) -> list[Row]:
    """Return and print the cycles of the afferent, of that gain which meets it best."""
    levels = np.geomspace(1.0, 5000.0, 160)
    _, gain, model = of_one(levels, site.cycles_of_one(neuron, ENTRAINMENT_HZ, levels))
    rows = [
        Row("RA", "entrainment", ENTRAINMENT_HZ, *pair, one, True)
        for pair, one in zip(ENTRAINMENT, model.tolist(), strict=True)
    ]
    told = ", ".join(f"{row.amplitude_um:g} µm {row.measured:g} {row.model:.2f}" for row in rows)
    print(f"RA entrainment at 40 Hz, gain {gain:.2f} times the median: {told} per cycle")
    return rows


def cycles(site: Site, neuron: Neuron, where: str) -> list[Row]:
    """Return and print humans' cycles; 125 µm is the amplitude, or from end to end."""
    ends = {"amplitude": CYCLES_UM, "peak to peak": CYCLES_UM / 2}
    found: dict[str, list[Row]] = {end: [] for end in ends}
    for f, measured in CYCLES[site.kind].items():
        model = site.cycles(neuron, f, list(ends.values())).tolist()
        for (end, amplitude), one in zip(ends.items(), model, strict=True):
            row = Row(site.kind, f"humans, {where}, {end}", f, amplitude, measured, one, False)
            found[end].append(row)
    for rows in found.values():
        told = ", ".join(
            f"{row.frequency_Hz:g} Hz {row.measured:g} {row.model:.2f}" for row in rows
        )
        print(f"{site.kind} {rows[0].what}, predicted: {told} per cycle")
    return [row for rows in found.values() for row in rows]


def print_amplitudes(spectrum: Spectrum, neurons: dict[str, Neuron]) -> None:
    """Print the mean rates over amplitude and frequency."""
    print("spikes/s at " + ", ".join(f"{a:g}" for a in AMPLITUDES_UM) + " µm")
    for kind, neuron in neurons.items():
        site = Site(spectrum, kind)
        for f in (4.0, 16.0, 50.0, 100.0, 300.0):
            told = " ".join(f"{f * c:.0f}" for c in site.cycles(neuron, f, AMPLITUDES_UM))
            print(f"{kind} {f:g} Hz: {told}")


def print_ramps(radius: float, share: np.ndarray, felt: np.ndarray, neuron: Neuron) -> None:
    """Print spikes and shortest interval of the afferent of median gain in each ramp."""
    told = []
    for speed, count, shortest in RAMPS:
        time_s = np.append(share * RAMPS_MM / speed, RAMPS_MM / speed + RAMP_HOLD_S)
        fired = spikes(neuron, time_s, np.vstack([felt, felt[-1:]]))[0]
        least = 1000 * np.diff(fired).min() if len(fired) > 1 else np.nan
        told.append(f"{speed:g} mm/s {count} {len(fired)} {shortest:g} {least:.1f}")
    print(f"RA ramps, radius {radius:g} mm, spikes and shortest interval (ms): {', '.join(told)}")


def print_constants(kind: str, neuron: Neuron) -> None:
    """Print the constants that thresholds and rates determine."""
    print(
        f"{kind}: f_0 {neuron.filter_centre_Hz:.0f} Hz, Q {neuron.filter_quality:.2f}, "
        f"{neuron.filter_order} stages, gain {neuron.filter_gain_pA:.3g} pA per unit, its spread "
        f"{neuron.gain_spread:.2g}, membrane {1000 * neuron.time_constant_s:.2g} ms, refractory "
        f"{1000 * neuron.refractory_s:g} ms, threshold raised by {neuron.threshold_jump_mV:g} mV "
        f"for {1000 * neuron.threshold_recovery_s:g} ms, other direction {neuron.filter_off:g}"
    )


def print_thresholds(site: Site, neuron: Neuron) -> None:
    """Print the shape of the thresholds, with their mean level that of the measured ones."""
    measured, found = THRESHOLDS_UM[site.kind], thresholds_of(site, neuron)
    shape = dict(zip(site.spectrum.frequency_Hz.tolist(), found.tolist(), strict=True))
    away = {f: np.log(shape[f] / value) for f, value in measured.items()}
    level = np.exp(np.mean(list(away.values())))
    told = ", ".join(f"{f} Hz {value:g} {shape[f] / level:.2g}" for f, value in measured.items())
    best = min(shape, key=lambda f: shape[f])
    spread = np.std(list(away.values()))
    print(f"{site.kind} thresholds, µm (measured, shape): {told}; factor {np.exp(spread):.2f} rms")
    print(f"{site.kind} best frequency: {best:g} Hz")


if __name__ == "__main__":
    run_script(main)
