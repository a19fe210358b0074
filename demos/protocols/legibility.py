# %% [markdown]
# # Which letter was it?
#
# This demo emphasizes
# - a number for "obscure": how often a letter is told from its afferents' firing alone,
# - afferents that differ in gain and a threshold that is noisy from spike to spike,
# - a sweep over letters: one scan each, resumed, never repeated.
#
# Each letter is scanned once. Its strain energy densities then drive a population whose gains
# and thresholds vary: $n$ realizations of the rate image $r(x, d)$. Every image is read as the
# letter whose template, the mean of that letter's other images, it correlates with best after a
# shift of up to 1 mm:
#
# $$\hat L = \arg\max_L \max_\Delta\, \mathrm{corr}(r, \bar r_L(\cdot+\Delta)).$$
#
# This is an ideal observer of the array. People are not: naive readers recognise 49 to 51 % of
# embossed letters (Vega-Bermudez et al. 1991). A blur of the images, as a reader's limit, lowers
# the accuracy.
#
#     python demos/protocols/legibility.py results/legibility --jobs 2
#     python demos/protocols/legibility.py results/quick --letters CO --depth 0.6 --distance 0.6

# %%
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cyclopts import run

from tactile_fem.files import replacing, write_table
from tactile_fem.logs import set_up
from tactile_fem.reading import RateImage, Reading, population_image, read
from tactile_fem.reading.figures import confusion_figure
from tactile_fem.reading.legibility import outline_correlation
from tactile_fem.results import Results
from tactile_fem.series import run_series, sweep, write_summary
from tactile_fem.series.run import folder_of, is_complete


@dataclass(frozen=True)
class Row:
    """A letter's numbers."""

    letter: str
    spikes: int
    outline_correlation: float
    share_right: float
    mostly_read_as: str


# %% [markdown]
# Gains vary by 30 % (standard deviation of their logarithm) between afferents and thresholds by
# 10 % from spike to spike. Both are proposed.


# %%
def main(
    folder: Path,
    *,
    letters: str = "CDFGHOQ",
    depth: float = 1.97,
    distance: float = 10.0,
    preset: str = "coarse",
    realizations: int = 10,
    gain_spread: float = 0.3,
    threshold_noise: float = 0.1,
    blur: float = 0.0,
    jobs: int = 1,
) -> None:
    """Scan each letter, fire, and read.

    Parameters
    ----------
    blur
        Standard deviation of a Gaussian over the images, mm: what a reader cannot resolve.
    jobs
        Scans at a time.
    """
    set_up()
    overrides = [
        f"finger.preset={preset}",
        f"protocol.depth_mm={depth}",
        f"protocol.distance_mm={distance}",
    ]
    members = sweep([f"stimulus.text={','.join(letters)}"], overrides=overrides)
    run_series(members, folder, jobs=jobs)
    print(write_summary(members, folder))
    scans = {
        member.values["stimulus.text"]: Results.open(folder_of(member, folder))
        for member in members
        if is_complete(member, folder)
    }
    images = {
        letter: [
            noisy(results, k, gain_spread, threshold_noise) for k in range(1, realizations + 1)
        ]
        for letter, results in scans.items()
    }
    tell(scans, read(images, blur), folder, blur)


def noisy(results: Results, seed: int, gain_spread: float, threshold_noise: float) -> RateImage:
    """Return a realization of the population's image."""
    variability = {"gain_spread": gain_spread, "threshold_noise": threshold_noise, "seed": seed}
    return population_image(results, results.study.neuron.model_copy(update=variability))


def tell(scans: dict[str, Results], reading: Reading, folder: Path, blur: float) -> None:
    """Print and draw which letter was read as which."""
    rows = []
    for k, letter in enumerate(reading.letters):
        image = population_image(scans[letter])
        own = reading.confusion[k]
        rows.append(
            Row(
                letter,
                int(image.response.counts().sum()),
                round(outline_correlation(image, scans[letter].study.stimulus), 3),
                round(float(own[k] / own.sum()), 3),
                reading.letters[int(np.argmax(own))],
            )
        )
        r = rows[-1]
        print(
            f"{letter}: {r.spikes:5d} spikes, outline r = {r.outline_correlation:.3f}, "
            f"{100 * r.share_right:3.0f} % right, mostly read as {r.mostly_read_as}"
        )
    print(f"{100 * reading.accuracy:.1f} % right of {reading.confusion.sum()}, blur {blur:g} mm")
    write_table(folder / "legibility.csv", rows)
    title = "population" if not blur else f"population, blur {blur:g} mm"
    with replacing(folder / "confusion.png") as part:
        confusion_figure({title: reading}).savefig(part, format="png")
    print(folder / "confusion.png")


if __name__ == "__main__":
    run(main)
