# %% [markdown]
# # The neuron fitted to monkeys' afferents, and everything else predicted
#
# The drive $D$, strain energy density in kPa, is compressed by a power and adapts twice, fast and
# within a minute; currents below the membrane's rheobase evoke no spikes:
#
# $$I = \alpha\,(S - \kappa_f a_f - \kappa a), \quad S = D^p, \quad
# \tau_f \dot a_f = S - a_f, \quad \tau_a \dot a = S - a.$$
#
# Fitted are $\alpha$, $p$ and both shares $\kappa$; the times stay 10 ms and 60 s. The data are
# rates in the ramp (17) and the hold (17) of a bar, under spheres (21), on textures (8), and their
# decline in holds of 12 s (2). Each of these experiments counts by the share of its variance. The
# model's rate is the membrane's steady rate at the present current: what many trials with irregular
# spikes tend to. Other laws: `laws.py`.
#
#     python demos/validation/calibrate.py results/neurons

# %%
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import recordings
from felt_quantities import FELT
from human_afferents import HumanAfferent
from laws import experiments
from letter_firing import LetterFiring
from recordings import HOLD_S, ONSET, RAMP, RAMP_S, Array, measured, rates_of

from tactile_fem import run_script, write_table
from tactile_fem.neuron import (
    Drive,
    RateFit,
    Recording,
    Window,
    fit,
    mean_rates,
    modelled_rates,
    r_squared,
)
from tactile_fem.study import Neuron

FREE = "static_gain_pA_per_kPa", "power", "fast_adaptation", "adaptation"
RAMP_HZ, HELD_HZ = (100.0, 200.0), (10.0, 50.0)  # expected under cylinders
LARGEST_HZ, SILENT_HZ = 200.0, 10.0  # expected under letters
AWAY_MM = (1.5, 1.0)


@dataclass(frozen=True)
class Row:
    """A quantity, measured or expected, beside the model's."""

    quantity: str
    measured: str
    model: str
    met: str = ""


def modelled(some: Sequence[Recording], neuron: Neuron) -> Array:
    """Return the model's mean rates in all windows, one after another, spikes/s."""
    return np.concatenate([modelled_rates(one, neuron).ravel() for one in some])


# %%
def main(folder: Path, *, people: bool = False) -> None:
    """Fit, predict and print.

    Parameters
    ----------
    folder
        Folder for the table.
    people
        Whether to print people's afferents for each punch that may have been used.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drive = FELT["sed"]
    fitted = fit([one for some in experiments(drive).values() for one in some], Neuron(), FREE)
    print_constants(fitted)
    if people:
        for radius in recordings.PUNCHES_MM:
            print_people(drive, fitted.neuron, radius)
    rows = list(table(fitted.neuron, drive))
    print("\n| quantity | measured | model | met |\n| --- | --- | --- | --- |")
    for row in rows:
        print(f"| {row.quantity} | {row.measured} | {row.model} | {row.met} |")
    write_table(folder / "rates.csv", rows)


# %%
def print_constants(found: RateFit) -> None:
    """Print the constants, their intervals and correlations."""
    for name, e in found.estimates.items():
        print(f"{name:27s} {e.value:9.4g}  (95 %: {e.low:.4g} to {e.high:.4g}) {e.doubt}")
    pairs = zip(*np.triu_indices(len(found.estimates), 1), strict=True)
    print("correlations: " + ", ".join(f"{found.correlation[pair]:+.2f}" for pair in pairs))


def print_people(drive: Drive, neuron: Neuron, radius_mm: float) -> None:
    """Print how people's afferents differ from the model's, for a punch."""
    for person in (
        HumanAfferent.of(drive, neuron, "b", radius_mm),
        HumanAfferent.of(drive, neuron, "a", radius_mm),
    ):
        onset, late = person.model_Hz
        print(
            f"punch of {2 * radius_mm:g} mm, {person.told}; spikes in {ONSET[1]:g} s "
            f"{', '.join(f'{ONSET[1] * rate:.0f}' for rate in onset)}; "
            f"late {', '.join(f'{rate:.0f}' for rate in late)} spikes/s"
        )


# %%
def table(neuron: Neuron, drive: Drive) -> Iterator[Row]:
    """Yield all rows: what is fitted first, then what is predicted."""
    rates = modelled([recordings.bar(drive)], neuron).reshape(2, -1)
    bar = measured("bar")
    yield agreement("bar, ramp (17)", rates[0], bar["ramp_Hz"])
    yield agreement("bar, hold (17)", rates[1], bar["hold_Hz"])
    yield predicted("spheres (21)", recordings.spheres(drive), neuron)
    yield predicted("textures (8)", recordings.textures(drive), neuron)
    yield from second_rows(drive, neuron)
    yield predicted("bar, hold, second reading (25)", [recordings.bar_again(drive)], neuron)
    yield predicted("aperiodic grating (12)", recordings.grating(drive), neuron)
    yield from periodic_rows(drive, neuron)
    yield probe_row(drive, neuron)
    yield from cylinder_rows(drive, neuron)
    yield from letter_rows(drive, neuron)


def second_rows(drive: Drive, neuron: Neuron) -> Iterator[Row]:
    """Yield the decline over seconds, and people with gain and threshold of their own."""
    for one, depth in zip(recordings.decline(drive), measured("decline")["depth_mm"], strict=True):
        (model,), (left,) = modelled_rates(one, neuron)[1], one.windows[1].rate_Hz
        yield Row(f"rate left after 12 s, {depth:g} mm", f"{left:.2f}", f"{model:.2f}")
    for name in ("b", "a"):
        person = HumanAfferent.of(drive, neuron, name, recordings.PUNCH_MM)
        onset, late = zip(person.model_Hz, person.measured_Hz, strict=True)
        yield agreement(f"{person.told}, first {ONSET[1]:g} s", *onset)
        yield agreement(f"{person.told}, hold", *late)


def predicted(name: str, some: list[Recording], neuron: Neuron) -> Row:
    """Return how well the model predicts recordings."""
    return agreement(name, modelled(some, neuron), rates_of(some))


def agreement(name: str, model: Array, rates: Array) -> Row:
    """Return a row of the variance explained, and of the correlation: afferents differ in gain."""
    rms = np.sqrt(np.mean((model - rates) ** 2))
    r = np.corrcoef(model, rates)[0, 1]
    ends = f"{rates.min():.0f} to {rates.max():.0f} spikes/s"
    return Row(name, ends, f"R² {r_squared(model, rates):.3f}, r {r:.3f}, rms {rms:.0f}")


def said(met: bool) -> str:
    """Return how a table says whether an expectation is met."""
    return "yes" if met else "**missed**"


def periodic_rows(drive: Drive, neuron: Neuron) -> Iterator[Row]:
    """Yield rates at edge, ridge and groove of gratings over the mean of all, edges twice."""
    some = recordings.periodic(drive)
    rates = modelled(some, neuron).reshape(-1, 3)
    rates /= np.average(rates, axis=1, weights=(2, 1, 1)).mean()
    for period, one, own in zip(measured("periodic")["period_mm"], some, rates, strict=True):
        (window,) = one.windows
        parts = (" ".join(f"{x:.2f}" for x in each) for each in (np.ravel(window.rate_Hz), own))
        yield Row(f"grating of {period:g} mm: edge, ridge, groove", *parts)


def probe_row(drive: Drive, neuron: Neuron) -> Row:
    """Return the areas in which a probe makes an afferent fire."""
    depths, areas = measured("probe").values()
    return Row(
        f"field of a probe {', '.join(f'{depth:g}' for depth in depths)} mm deep",
        ", ".join(f"{area:.1f}" for area in areas) + " mm²",
        ", ".join(f"{field_mm2(drive, depth, neuron):.1f}" for depth in depths) + " mm²",
    )


def field_mm2(drive: Drive, depth_mm: float, neuron: Neuron) -> float:
    """Return the area of the ellipse in which an afferent fires in ramp or hold."""
    felt, time, values = recordings.probe(drive, depth_mm)
    whole = Window(0.0, RAMP_S + HOLD_S, np.zeros(values.shape[1]))
    fires = mean_rates(time, values, [whole], neuron)[0] > 0
    x = felt.x_mm[fires & (np.abs(felt.y_mm) < 1e-6)]
    y = felt.y_mm[fires & (np.abs(felt.x_mm) < 1e-6)]
    return float(np.pi / 4 * np.ptp(x) * np.ptp(y)) if len(x) and len(y) else 0.0


def cylinder_rows(drive: Drive, neuron: Neuron) -> Iterator[Row]:
    """Yield the rates under the axes of cylinders."""
    rates = []
    for radius, (time, values) in recordings.cylinders(drive).items():
        end = Window(time[-1] - 1e-3, time[-1], [0.0])
        ramp, after = mean_rates(time, values, [Window(*RAMP, [0.0]), end], neuron)[:, 0]
        rates.append((ramp, after))
        met = RAMP_HZ[0] <= ramp <= RAMP_HZ[1] and HELD_HZ[0] <= after <= HELD_HZ[1]
        yield Row(
            f"cylinder of {radius:g} mm: ramp, after 1 s",
            "100 to 200, 10 to 50 spikes/s",
            f"{ramp:.0f}, {after:.0f}",
            said(met),
        )
    falling = bool((np.diff(rates, axis=0) < 0).all())
    yield Row("rates fall with the radius", "yes", "yes" if falling else "no", said(falling))


def letter_rows(drive: Drive, neuron: Neuron) -> Iterator[Row]:
    """Yield what is known of afferents under letters."""
    fired = LetterFiring.of(neuron, drive)
    peak = float(fired.response.peak_rate()[fired.middle])
    yield Row(
        "letters: peak of the middle afferent",
        f"at most about {LARGEST_HZ:.0f} spikes/s",
        f"{peak:.0f}",
        said(peak <= 1.05 * LARGEST_HZ),
    )
    for away_mm in AWAY_MM:
        away = fired.rate_away(away_mm)
        yield Row(
            f"letters: farther than {away_mm:g} mm from strokes",
            f"under {SILENT_HZ:.0f} spikes/s",
            f"{away:.1f}",
            said(away < SILENT_HZ),
        )
    yield Row("letters: bursts", "one for each stroke", fired.bursts())
    counts = ", ".join(str(count) for count in fired.response.counts())
    yield Row("letters: spikes of afferents 1 mm apart", "fewer outside", counts)


# %%
if __name__ == "__main__":
    run_script(main)
