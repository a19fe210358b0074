# %% [markdown]
# # Which law of SA1 afferents predicts an experiment that it was not fitted to
#
# What is felt, how it is compressed and how it adapts are varied. Each law is fitted to the bar,
# the spheres, the decline in holds and the textures of monkeys' afferents together
# (`recordings.py`), each counting by the share of its variance, and then to all but one of them, to
# predict that one. Laws are compared by what they predict, not by what they fit.
#
# - felt: strain energy density, largest stretch, compressive stress, increase of area; at the
#   receptor or as a mean over a cluster of end organs,
# - how: linear above a threshold, a power, a power above a threshold, a logarithm,
# - adaptation: fast (10 ms) and slow, of 10, 60 or 150 s, on the drum for minutes; or fast alone.
#
#     python demos/validation/laws.py results/laws
#     python demos/validation/laws.py results/laws --felt sed --how power --slow 60

# %%
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import recordings
from felt_quantities import FELT
from recordings import Recording, rates_of

from tactile_fem import run_script, write_table
from tactile_fem.neuron import Drive, FitWarning, fit, modelled_rates, r_squared
from tactile_fem.study import Neuron

GAIN, FAST, SLOW = "static_gain_pA_per_kPa", "fast_adaptation", "adaptation"
# What is free besides the gain and the adaptations.
HOW = {
    "linear above threshold": ("drive_threshold_kPa",),
    "power": ("power",),
    "power above threshold": ("power", "drive_threshold_kPa"),
    "logarithm": ("compression_kPa",),
}
SLOW_S = (0.0, 10.0, 60.0, 150.0)  # 0: there is none
# Where fits start, relative to the largest drive under a sphere, and shares of both adaptations.
STARTS = ((0.02, 0.92, 0.03), (0.1, 0.96, 0.1))

Experiments = dict[str, list[Recording]]


@dataclass(frozen=True)
class Row:
    """A law: what it explains of each experiment, fitted to all and to the others."""

    felt: str
    how: str
    slow_s: float
    constants: int
    sum_of_squares: float
    bar: float
    spheres: float
    decline: float
    textures: float
    bar_predicted: float
    spheres_predicted: float
    decline_predicted: float
    textures_predicted: float
    values: str

    @property
    def predicted(self) -> float:
        """The mean of what is predicted; less than nothing counts as nothing."""
        parts = self.bar_predicted, self.spheres_predicted, self.textures_predicted
        return float(np.mean(np.maximum(parts, 0.0)))


def experiments(drive: Drive) -> Experiments:
    """Return all that laws are compared by."""
    return {
        "bar": [recordings.bar(drive)],
        "spheres": recordings.spheres(drive),
        "decline": recordings.decline(drive),
        "textures": recordings.textures(drive),
    }


# %%
def main(
    folder: Path,
    *,
    felt: tuple[str, ...] = (),
    how: tuple[str, ...] = (),
    slow: tuple[float, ...] = (),
) -> None:
    """Fit every law and print what it explains and predicts, the best last.

    Parameters
    ----------
    folder
        Folder for the table.
    felt, how
        Names, all unless given.
    slow
        Times of the slow adaptation, s, all unless given; 0 for none.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for what in felt or FELT:
        known = experiments(FELT[what])
        for form, time_s in product(how or HOW, slow or SLOW_S):
            rows.append(compared(what, form, time_s, known))
            print(told(rows[-1]), flush=True)
    rows.sort(key=lambda row: row.predicted)
    write_table(folder / "laws.csv", rows)
    print("\nThe best by what they predict:")
    for row in rows[-10:]:
        print(f"{told(row)} {row.values}")


def told(row: Row) -> str:
    """Return a line of the table."""
    law = f"{row.felt}, {row.how}, {row.slow_s:g} s ({row.constants})"
    fitted = f"{row.bar:.2f} {row.spheres:.2f} {row.decline:.2f} {row.textures:.2f}"
    others = (
        f"{row.bar_predicted:.2f} {row.spheres_predicted:.2f} {row.decline_predicted:.2f} "
        f"{row.textures_predicted:.2f}"
    )
    return f"{law:62s} {row.sum_of_squares:6.1f}  R2 {fitted}, predicted {others}"


def compared(felt: str, how: str, slow_s: float, known: Experiments) -> Row:
    """Fit a law to all experiments, and to all but each one in turn."""
    free = (GAIN, FAST, *((SLOW,) if slow_s else ()), *HOW[how])
    neuron, squares = best(known, started(how, slow_s, known), free)
    own = {name: explained(some, neuron) for name, some in known.items()}
    for name in known:
        others = {other: some for other, some in known.items() if other != name}
        left, _ = best(others, [neuron, *started(how, slow_s, known)[:1]], free)
        own[f"{name}_predicted"] = explained(known[name], left)
    values = ", ".join(f"{name} {getattr(neuron, name):.4g}" for name in free)
    return Row(felt, how, slow_s, len(free), squares, values=values, **own)


def started(how: str, slow_s: float, known: Experiments) -> list[Neuron]:
    """Return where fits begin."""
    largest = max(float(np.max(one.drive)) for one in known["spheres"])
    found = []
    for share, fast, slow in STARTS:
        values = {
            "model": "logarithmic" if how == "logarithm" else "power",
            "power": 1.0 if how.startswith("linear") else 0.5,
            "drive_threshold_kPa": 0.2 * share * largest if "threshold" in how else 0.0,
            "compression_kPa": share * largest,
            GAIN: 1000.0 / largest,
            FAST: fast,
            SLOW: slow if slow_s else 0.0,
            "adaptation_time_s": slow_s or 10.0,
        }
        found.append(Neuron.model_validate(values))
    return found


def best(known: Experiments, starts: list[Neuron], free: tuple[str, ...]) -> tuple[Neuron, float]:
    """Return the neuron with the smallest sum of squared deviations, in standard deviations."""
    some = [one for each in known.values() for one in each]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        fits = [fit(some, start, free).neuron for start in starts]
    squares = [float(np.sum(np.concatenate(list(deviations(some, one))) ** 2)) for one in fits]
    return fits[int(np.argmin(squares))], min(squares)


def deviations(some: list[Recording], neuron: Neuron) -> Iterator[np.ndarray]:
    """Yield model less measurement in all windows, in standard deviations."""
    for one in some:
        for rates, window in zip(modelled_rates(one, neuron), one.windows, strict=True):
            yield (rates - window.rate_Hz) / window.sd_Hz


def explained(some: list[Recording], neuron: Neuron) -> float:
    """Return the share of the variance that is explained; of declines, of the last rates."""
    rates = [modelled_rates(one, neuron) for one in some]
    if some[0].relative:
        last = np.array([each[-1, 0] for each in rates])
        left = np.array([np.ravel(one.windows[-1].rate_Hz)[0] for one in some])
        return float(1 - np.sum((last - left) ** 2) / np.sum((1 - left) ** 2))
    return r_squared(np.concatenate([each.ravel() for each in rates]), rates_of(some))


# %%
if __name__ == "__main__":
    run_script(main)
