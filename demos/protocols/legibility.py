# %% [markdown]
# # Recognition of letters from their firing images
#
# This demo emphasizes
# - how often a letter is recognised from the firing of its afferents,
# - afferents that differ in gain, with a threshold that varies from spike to spike,
# - a sweep over letters, with one scan each; with `--passes` also the classic protocol, one fibre
#   in passes at this distance in mm.
#
# Each letter is scanned once. Its strain energy densities then drive a population whose gains
# and thresholds vary: $n$ realizations of the rate image $r(x, d)$. A letter's template is the mean
# of its other images. Every image is recognised as the letter whose template it correlates with
# best, at the best shift of up to 1 mm:
#
# $$\hat L = \arg\max_L \max_\Delta\, \mathrm{corr}(r, \bar r_L(\cdot+\Delta)).$$
#
# The templates $\bar r_L$ contain no image of the population that produced $r$, with its gains and
# its noise. This is an ideal observer, unlike people: naive readers recognise 49 to 51 % of
# embossed letters (Vega-Bermudez et al. 1991). `--accuracy 0.5` gives the reader as much noise of
# its own, added to each pixel, as brings the population's accuracy down to that; `--noise` sets it.
# Blurring the images models a reader's limited resolution.
#
#     python demos/protocols/legibility.py results/alphabet --jobs 2 --accuracy 0.5 \
#         --letters ABCDEFGHIJKLMNOPQRSTUVWXYZ
#     python demos/protocols/legibility.py results/legibility --jobs 2 --passes 1.0 --blur 0 1.5
#     python demos/protocols/legibility.py results/quick --letters CO --depth 0.6 --distance 0.6

# %%
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from firing_images import letters_figure, population_image, with_row_spacing
from letter_recognition import (
    Recognition,
    confusion_figure,
    noise_of_reader,
    outline_correlation,
    recognise,
)
from matplotlib.figure import Figure

from tactile_fem import Results, run_script, write_table
from tactile_fem.output.histories import rings
from tactile_fem.series import (
    RateImage,
    complete_scans,
    fibre_image,
    run_series,
    single_fibre,
    sweep,
    write_summary,
)
from tactile_fem.study import Neuron

_TOLD = 8  # how many letters and pairs are printed


@dataclass(frozen=True)
class Row:
    """A letter's numbers for one blur of the images."""

    letter: str
    spikes: int
    outline_correlation: float
    blur_mm: float
    share_correct: float
    mostly_recognised_as: str


# %% [markdown]
# Gains vary by 30 % (standard deviation of their logarithm) between afferents and thresholds by
# 10 % from spike to spike. Both are proposed.


# %%
def main(
    folder: Path,
    *,
    letters: str = "CDFGHOQ",
    depth: float = 1.97,
    force: float | None = None,
    distance: float = 10.0,
    output: float = 0.1,
    preset: str = "coarse",
    realizations: int = 10,
    gain_spread: float = 0.3,
    threshold_noise: float = 0.1,
    blur: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (0.0,),
    noise: float = 0.0,
    accuracy: float | None = None,
    passes: float | None = None,
    set_: Annotated[tuple[str, ...], Parameter(name="--set", consume_multiple=True)] = (),
    jobs: int = 1,
) -> None:
    """Scan each letter, compute images of firing and recognise them.

    Parameters
    ----------
    force
        Normal force that is held in the slide, N, in place of a depth.
    blur
        Standard deviations of a Gaussian over the images, mm: a reader's resolution.
    noise
        The reader's inner noise, spikes/s.
    accuracy
        Share of the population's images, with the first blur, that is recognised; sets the noise.
    passes
        Shift between two passes over one fibre, mm; without it only the population is used. The
        population's images then have the same row spacing.
    output
        Spacing of the output positions in the slide, mm; steps are at most this long.
    set_
        Further values of the study, ``section.key=value``.
    jobs
        Parallel scans.
    """
    overrides = [
        f"finger.preset={preset}",
        f"protocol.depth_mm={depth}" if force is None else f"protocol.force_N={force}",
        *([] if force is None else ["protocol.hold=force"]),
        f"protocol.distance_mm={distance}",
        f"protocol.output_mm={output}",
        *set_,
    ]
    members = sweep([f"stimulus.text={','.join(letters)}"], overrides=overrides)
    run_series(members, folder, jobs=jobs)
    print(write_summary(members, folder))
    scans = {scan.study.stimulus.text: scan for scan in complete_scans(members, folder)}
    variety = {"gain_spread": gain_spread, "threshold_noise": threshold_noise}
    of_population = population_image if passes is None else partial(rows_of_population, passes)
    makers = {
        "population": {letter: partial(of_population, scan) for letter, scan in scans.items()}
    }
    if passes is not None:
        makers["single fibre"] = {
            letter: partial(fibre_image, passes_of(scan, passes, folder / "passes" / letter, jobs))
            for letter, scan in scans.items()
        }
    results, plain = {}, {}
    for protocol, of_letter in makers.items():
        images = {
            letter: realized(make, scans[letter], variety, realizations)
            for letter, make in of_letter.items()
        }
        if protocol == "population" and accuracy is not None:
            noise = noise_of_reader(images, accuracy, blur[0])
            print(f"the reader's noise: {noise:.0f} spikes/s")
        results[protocol] = {width: recognise(images, width, noise) for width in blur}
        plain[protocol] = {letter: make() for letter, make in of_letter.items()}
        print_results(protocol, plain[protocol], scans, results[protocol], folder)
    outlines = {letter: rings(scan.study.stimulus) for letter, scan in scans.items()}
    figures = {
        "letters": letters_figure(plain, outlines),
        "confusion": confusion_figure(results),
    }
    save(figures, folder)


def save(figures: Mapping[str, Figure], folder: Path) -> None:
    """Write figures under their names and print where they are."""
    for name, figure in figures.items():
        path = folder / f"{name}.png"
        figure.savefig(path)
        print(path)


def rows_of_population(spacing: float, scan: Results, neuron: Neuron | None = None) -> RateImage:
    """Return the population's image with the row spacing of the passes."""
    return with_row_spacing(population_image(scan, neuron), spacing)


def realized(
    image_of: Callable[[Neuron], RateImage], scan: Results, variety: dict[str, float], count: int
) -> list[RateImage]:
    """Return images of that many populations, with the scan's neuron and variability."""
    neuron = scan.study.neuron
    return [
        image_of(neuron.model_copy(update={**variety, "seed": seed}))
        for seed in range(1, count + 1)
    ]


def passes_of(scan: Results, spacing: float, folder: Path, jobs: int) -> list[Results]:
    """Return the passes with a scan's letter, running missing ones; the scan is one of them."""
    half_width = scan.study.receptors.half_width_mm
    passes = single_fibre(scan.study, spacing_mm=spacing, half_width_mm=half_width)
    members = [member for member in passes if member.values["shift_mm"]]
    run_series(members, folder, jobs=jobs)
    write_summary(members, folder)
    return [scan, *complete_scans(members, folder)]


def print_results(
    protocol: str,
    images: dict[str, RateImage],
    scans: dict[str, Results],
    recognitions: dict[float, Recognition],
    folder: Path,
) -> None:
    """Print how each letter was recognised, and the correlation of its image with its outline."""
    rows = []
    for letter, image in images.items():
        r = outline_correlation(image, scans[letter].study.stimulus)
        spikes = int(image.response.counts().sum())
        print(f"{protocol} {letter}: {spikes:5d} spikes, outline r = {r:.3f}")
        for width, recognition in recognitions.items():
            own = recognition.confusion[recognition.letters.index(letter)]
            correct = float(own[recognition.letters.index(letter)] / own.sum())
            mostly = recognition.letters[int(np.argmax(own))]
            rows.append(Row(letter, spikes, round(r, 3), width, round(correct, 3), mostly))
            print(
                f"    blur {width:g} mm: {100 * correct:3.0f} % correct, mostly taken for {mostly}"
            )
    for width, recognition in recognitions.items():
        print_found(protocol, width, recognition)
    write_table(folder / f"{protocol.replace(' ', '_')}.csv", rows)


def print_found(protocol: str, width: float, recognition: Recognition) -> None:
    """Print how many images were recognised, the hardest letters and the most mistaken pairs."""
    share = f"{100 * recognition.accuracy:.1f} % correct of {recognition.confusion.sum()}"
    print(f"{protocol}, blur {width:g} mm: {share}")
    hardest = [(name, value) for name, value in recognition.hardest() if value < 1]
    mistaken = [(name, value) for name, value in recognition.mistaken() if value > 0]
    for what, found in (("hardest", hardest), ("most mistaken", mistaken)):
        told = ", ".join(f"{name} {100 * value:.0f} %" for name, value in found[:_TOLD])
        print(f"    {what}: {told or 'none'}")


if __name__ == "__main__":
    run_script(main)
