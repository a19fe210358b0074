# %% [markdown]
# # The neuron fitted to a bar's profile, and four cylinders predicted
#
# This demo emphasizes
# - input and results of `tactile_fem.neuron.fit`: constants, intervals, undetermined parameters,
# - how well one half of the positions predicts the other,
# - the part of the rates that strain energy density cannot explain.
#
# Phillips and Johnson (1981) pressed a bar 3 mm wide 1 mm deep at distances $y$ from SA1 afferents
# of monkeys; they give a dynamic and a static rate. Here the dynamic rate is the mean over the ramp
# of 50 ms, the static one the mean over the second half of a hold of 1 s (both assumed). The
# model's rate is the membrane's steady rate at the current
#
# $$I = I_0 + \alpha (S - \kappa a) + \beta \max(\dot S, 0), \quad \tau_a \dot a = S - a,$$
#
# with $I_0 = V_{th}/R$; $\alpha$ and $\beta$ are fitted. $\kappa = 0.45$ and $\tau_a = 0.5$ s
# are fixed, because two windows do not determine them, as the demo shows by fitting them too.
#
# $S$ comes from `histories.py`. If two receptors with equal $S$ fire differently, no neuron model
# can fit both. Isotonic regression of the rates on $S$ during the hold quantifies this.
#
#     python demos/neurons/fit_bar.py results/neurons

# %%
import csv
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import isotonic_regression

from tactile_fem.cli.entry import run
from tactile_fem.neuron import Fit, FitWarning, Recording, Window, fit, respond
from tactile_fem.neuron.fit import mean_rates
from tactile_fem.runtime.files import write_table
from tactile_fem.runtime.ranks import launched_rank
from tactile_fem.study import Neuron

# y mm: dynamic, static spikes/s.
MEASURED = {
    -2.5: (20, 1),
    -2.1: (135, 15),
    -1.7: (210, 48),
    -1.5: (200, 59),
    -1.3: (150, 61),
    -1.1: (90, 39),
    -0.9: (79, 15),
    -0.5: (72, 10),
    0.0: (70, 8),
    0.5: (73, 10),
    0.9: (102, 25),
    1.1: (130, 41),
    1.3: (167, 51),
    1.5: (172, 55),
    1.7: (150, 37),
    1.9: (72, 19),
    2.5: (4, 2),
}
RAMP_S, HOLD_S = 0.05, 1.0
RADII_MM = (1.59, 3.18, 6.35, 12.7)
START = Neuron(
    static_gain_pA_per_kPa=100.0,
    dynamic_gain_pA_s_per_kPa=10.0,
    adaptation=0.45,
    adaptation_time_s=0.5,
)
GAINS = ("static_gain_pA_per_kPa", "dynamic_gain_pA_s_per_kPa")
NOISE, TRIALS = 0.1, 200
BLUE, ORANGE, GREEN, INK = "#0072B2", "#D55E00", "#009E73", "#222222"


@dataclass(frozen=True)
class Row:
    """Measured and fitted rates at one position."""

    y_mm: float
    sed_kPa: float
    dynamic_Hz: float
    dynamic_model_Hz: float
    static_Hz: float
    static_model_Hz: float


@dataclass(frozen=True)
class Cylinder:
    """Predicted rates under the axis of a cylinder."""

    radius_mm: float
    sed_kPa: float
    ramp_peak_Hz: float
    ramp_mean_Hz: float
    after_1_s_Hz: float


# %%
def main(
    folder: Path, *, histories: Path = Path(__file__).with_name("histories"), every: int = 1
) -> None:
    """Fit, predict, print and draw; only `every` n-th position is used."""
    if launched_rank():
        return
    folder.mkdir(parents=True, exist_ok=True)
    y = np.array(list(MEASURED))[::every]
    rates = np.array(list(MEASURED.values()), dtype=float)[::every].T
    time, places, felt = load(histories / "bar.csv")
    sed = felt[:, [int(np.abs(places - at).argmin()) for at in y]]
    halves(time, sed, rates, y)
    fitted = fit([Recording(time, sed, windows(rates))], START, GAINS)
    print_results(fitted)
    undetermined(time, sed, rates)
    bound(sed[-1], rates)
    by_spikes(time, sed, rates, fitted.neuron)
    model = mean_rates(time, sed, windows(rates), fitted.neuron)
    columns = np.column_stack([y, sed[-1], rates[0], model[0], rates[1], model[1]])
    write_table(folder / "bar.csv", [Row(*row) for row in columns.tolist()])
    draw_bar(time, places, felt, y, rates, fitted.neuron, folder / "bar.png")
    cylinders(histories, fitted.neuron, folder)


def load(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, receptor positions and SED, with the hold extended to its full length."""
    with path.open(newline="", encoding="utf-8") as stream:
        heading, *rows = csv.reader(stream)
    values = np.array(rows, dtype=float)
    time = np.append(values[:, 0], RAMP_S + HOLD_S)
    return time, np.array(heading[1:], dtype=float), np.vstack([values[:, 1:], values[-1, 1:]])


def windows(rates: np.ndarray) -> list[Window]:
    """Return ramp and second half of the hold with (2, receptors) rates."""
    end = RAMP_S + HOLD_S
    return [Window(0.0, RAMP_S, rates[0]), Window(end - HOLD_S / 2, end, rates[1])]


# %% [markdown]
# Each half of the positions is fitted and predicts the other. The left and right halves differ
# most, because neither the measured profile nor the finger is symmetric.


# %%
def halves(time: np.ndarray, sed: np.ndarray, rates: np.ndarray, y: np.ndarray) -> None:
    """Print R2 of both parts for three ways to choose the fitted half."""
    ways = {"y < 0": y < 0, "y > 0": y > 0, "every second": np.arange(len(y)) % 2 == 0}
    print(f"{'R2':16s}{'fitted: dynamic, static, both':32s}{'predicted':32s}alpha    beta")
    for name, part in ways.items():
        half = Recording(time, sed[:, part], windows(rates[:, part]))
        found = fit([half], START, GAINS)
        rest = windows(rates[:, ~part])
        predicted = agreement(mean_rates(time, sed[:, ~part], rest, found.neuron), rates[:, ~part])
        values = [f"{e.value:7.1f}" for e in found.estimates.values()]
        print(f"{name:12s}{row(found.r2)}   {row(predicted)}     {' '.join(values)}")


def agreement(model: np.ndarray, measured: np.ndarray) -> tuple[float, ...]:
    """Return R2 of each window and of both together."""
    pairs = [*zip(model, measured, strict=True), (model, measured)]
    return tuple(1 - np.sum((a - b) ** 2) / np.sum((b - b.mean()) ** 2) for a, b in pairs)


def row(values: tuple[float, ...]) -> str:
    """Return numbers in columns."""
    return " ".join(f"{value:8.3f}" for value in values)


def print_results(found: Fit) -> None:
    """Print the constants fitted to all positions."""
    print("all positions:")
    for name, e in found.estimates.items():
        print(f"  {name:27s} {e.value:7.2f}  (95 %: {e.low:.2f} to {e.high:.2f}) {e.doubt}")
    print(f"  R2 dynamic, static, both {row(found.r2)}")
    rms = [np.sqrt(np.mean(off**2)) for off in found.residuals_Hz]
    print(
        f"  rms {rms[0]:.1f} and {rms[1]:.1f} spikes/s; correlation {found.correlation[0, 1]:.2f}"
    )


def undetermined(time: np.ndarray, sed: np.ndarray, rates: np.ndarray) -> None:
    """Print the fits in which adaptation or intercept are free as well."""
    for more in (("adaptation",), ("adaptation", "adaptation_time_s"), ("intercept_pA",)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", FitWarning)
            found = fit([Recording(time, sed, windows(rates))], START, (*GAINS, *more))
        print(f"with {', '.join(more)} free: R2 of both {found.r2[-1]:.3f}")
        for warning in caught:
            print(f"  {warning.message}")


def bound(held_kPa: np.ndarray, rates: np.ndarray) -> None:
    """Print the largest R2 of any increasing function of SED during the hold."""
    order = np.argsort(held_kPa)
    best = np.array([isotonic_regression(r[order]).x for r in rates])
    print(f"R2 of the best increasing function of SED {row(agreement(best, rates[:, order]))}")


def by_spikes(time: np.ndarray, sed: np.ndarray, rates: np.ndarray, neuron: Neuron) -> None:
    """Print the agreement of counted spikes, mean over trials with irregular spikes."""
    noisy = neuron.model_copy(update={"threshold_noise": NOISE})
    response = respond(time, np.repeat(sed, TRIALS, axis=1), noisy)
    counted = [
        response.mean_rate(w.start_s, w.end_s).reshape(-1, TRIALS).mean(axis=1)
        for w in windows(rates)
    ]
    print(f"R2 of counted spikes, {TRIALS} trials {row(agreement(np.array(counted), rates))}")


# %%
def draw_bar(
    time: np.ndarray,
    places: np.ndarray,
    felt: np.ndarray,
    y: np.ndarray,
    rates: np.ndarray,
    neuron: Neuron,
    picture: Path,
) -> None:
    """Draw SED and both rates over the position, measured and fitted."""
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    near = np.abs(places) <= 3.0
    left.axvspan(-1.5, 1.5, color="#E6E3DC", lw=0)
    left.plot(places[near], felt[-1, near], color=INK)
    left.set(ylabel="Strain energy density in the hold (kPa)", ylim=(0, None))
    model = mean_rates(time, felt, windows(np.zeros((2, len(places)))), neuron)
    right.axvspan(-1.5, 1.5, color="#E6E3DC", lw=0, label="bar")
    for k, (name, color, marker) in enumerate((("ramp", ORANGE, "o"), ("hold", BLUE, "s"))):
        right.plot(places[near], model[k, near], color=color, label=f"{name}, model")
        right.plot(
            y, rates[k], marker, color=color, mfc="white", clip_on=False, label=f"{name}, measured"
        )
    right.set(ylabel="Firing rate (spikes/s)", ylim=(0, 290))
    right.legend(frameon=False, ncols=2, fontsize=8, loc="upper center")
    for axes in (left, right):
        axes.set_xlabel("Receptor from the bar's centre (mm)")
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, dpi=160)


# %% [markdown]
# The cylinders were not used in the fit. Peak: maximum rate of many trials, smoothed by a Gaussian
# of 10 ms; mean: steady rate averaged over the ramp; after 1 s: steady rate at the end of the hold.


# %%
def cylinders(histories: Path, neuron: Neuron, folder: Path) -> None:
    """Predict the rates under four cylinders; print, save and draw them."""
    rows, courses = [], []
    noisy = neuron.model_copy(update={"threshold_noise": NOISE})
    at = np.linspace(0.0, HOLD_S, 1001)
    for radius in RADII_MM:
        time, places, felt = load(histories / f"cylinder_{radius:g}.csv")
        sed = felt[:, [int(np.abs(places).argmin())]]
        moments = [Window(0.0, RAMP_S, [0.0]), Window(time[-1] - 1e-3, time[-1], [0.0])]
        ramp, end = mean_rates(time, sed, moments, neuron)[:, 0]
        response = respond(time, np.repeat(sed, TRIALS, axis=1), noisy)
        courses.append(response.rate(at, 0.01).mean(axis=1))
        numbers = (radius, sed[-1, 0], courses[-1].max(), ramp, end)
        rows.append(Cylinder(*map(float, numbers)))
    print("radius mm  SED kPa  ramp: peak  mean  after 1 s (spikes/s)")
    for r in rows:
        print(
            f"{r.radius_mm:9.2f} {r.sed_kPa:8.3f} {r.ramp_peak_Hz:11.1f} {r.ramp_mean_Hz:5.1f}"
            f" {r.after_1_s_Hz:10.1f}"
        )
    rates = np.array([(r.ramp_peak_Hz, r.ramp_mean_Hz, r.after_1_s_Hz) for r in rows])
    falling = "yes" if (np.diff(rates, axis=0) < 0).all() else "no"
    print(f"all rates fall with the radius: {falling}")
    write_table(folder / "cylinders.csv", rows)
    draw_cylinders(at, courses, rows, folder / "cylinders.png")


def draw_cylinders(
    at: np.ndarray, courses: list[np.ndarray], rows: list[Cylinder], picture: Path
) -> None:
    """Draw rates over time, and rates over curvature."""
    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [3, 2]})
    styles = ((ORANGE, "-"), (BLUE, "--"), (GREEN, "-."), (INK, ":"))
    for course, r, (color, line) in zip(courses, rows, styles, strict=True):
        left.plot(at, course, color=color, ls=line, lw=1.4, label=f"radius {r.radius_mm:g} mm")
    left.set(xlabel="Time from first touch (s)", ylabel="Firing rate (spikes/s)", ylim=(0, None))
    left.legend(frameon=False)
    curvature = [1 / r.radius_mm for r in rows]
    right.plot(curvature, [r.ramp_peak_Hz for r in rows], "o-", color=ORANGE, label="ramp, peak")
    right.plot(curvature, [r.after_1_s_Hz for r in rows], "s-", color=BLUE, label="after 1 s")
    right.set(xlabel="Curvature of the cylinder (1/mm)", ylim=(0, None), xlim=(0, None))
    right.legend(frameon=False)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, dpi=160)


# %%
if __name__ == "__main__":
    run(main)
