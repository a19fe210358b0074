# %% [markdown]
# # Our fields at receptors, given to the afferents of another package
#
# [SensoryForge](https://github.com/benefron/sensoryforge) (MIT) is a public model of tactile
# encoding in PyTorch. Its SA filter (Parvizi-Fard et al. 2021, equations 6 and 7) and its
# Izhikevich neuron, both with their own defaults, take our strain energy density, as our own
# afferents do. Its currents have no scale in kPa: the gain, the only free number, is chosen so that
# both fire as many spikes. What is compared is where they fire. Nothing of either is fitted to a
# measurement.
#
#     python demos/validation/other_models.py results/other_models
#     python demos/validation/other_models.py results/other_models --results results/letters
#
# It needs PyTorch, and SensoryForge from its repository. Without `--results`, the letter G of
# `demos/gallery/scans.zip` is used.

# %%
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from tactile_fem import Results, StudyError, run_script, write_table
from tactile_fem.neuron import SampledModel, save
from tactile_fem.series import RateImage, population_image
from tactile_fem.study import Neuron

SCANS = Path(__file__).parents[1] / "gallery" / "scans.zip"
LETTER = "letters/text-G"
GAINS = 0.1, 1000.0  # mA per kPa, between which the one for our number of spikes is sought
Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensoryForge:
    """Its slowly adapting afferents, as a model of samples of strain energy density, kPa."""

    gain_mA_per_kPa: float

    def __call__(self, sed_kPa: Array, step_s: float) -> Array:
        """Return which samples are spikes, (n, receptors)."""
        import torch
        from sensoryforge.filters.sa_ra import SAFilterTorch
        from sensoryforge.neurons import IzhikevichNeuronTorch

        with torch.no_grad():
            felt = torch.from_numpy(self.gain_mA_per_kPa * sed_kPa)[None]
            current = SAFilterTorch(dt=1e3 * step_s)(felt)
            _, spikes = IzhikevichNeuronTorch(dt=1e3 * step_s)(current)
        return spikes[0, : len(sed_kPa)].numpy()


@dataclass(frozen=True)
class Row:
    """What a model makes of the letter; `r` is the correlation of its image with the outline."""

    model: str
    spikes: int
    peak_Hz: float
    r: float


def gain_for(spikes: int, count: Callable[[float], int]) -> float:
    """Return the gain at which about so many spikes are counted; StudyError if none does."""
    low, high = np.log(GAINS)
    if not count(GAINS[0]) < spikes <= count(GAINS[1]):
        raise StudyError(f"No gain from {GAINS[0]} to {GAINS[1]} mA/kPa evokes {spikes} spikes.")
    return float(np.exp(brentq(lambda x: count(np.exp(x)) - spikes + 0.5, low, high, xtol=1e-2)))


def compared(results: Results, rate_Hz: float) -> dict[str, RateImage]:
    """Return the images of both models."""
    own = population_image(results, Neuron())
    wanted = int(own.response.counts().sum())

    def image(gain: float) -> RateImage:
        model = SampledModel(model=SensoryForge(gain), rate_Hz=rate_Hz)
        return population_image(results, population=model)

    gain = gain_for(wanted, lambda gain: int(image(gain).response.counts().sum()))
    print(f"gain of SensoryForge: {gain:.3g} mA/kPa")
    return {"ours": own, "SensoryForge": image(gain)}


def main(
    folder: Path = Path("results/other_models"),
    *,
    results: Path | None = None,
    rate_Hz: float = 10_000.0,
) -> None:
    """Print spikes and likeness to the letter of both models, and draw them.

    Parameters
    ----------
    folder
        Where table, picture and spikes are written.
    results
        A scan whose first afferents are SA1 on a line across the finger.
    rate_Hz
        Of the samples that SensoryForge takes.
    """
    if not find_spec("sensoryforge"):
        print("SensoryForge is not installed: see the first lines of this script")
        return
    with TemporaryDirectory() as away:
        if results is None:
            with ZipFile(SCANS) as archive:
                archive.extractall(away)
            results = Path(away, LETTER)
        scan = Results.open(results)
        images = compared(scan, rate_Hz)
    folder.mkdir(parents=True, exist_ok=True)
    pixels = {name: image.rate_Hz.ravel() for name, image in images.items()}
    alike = np.corrcoef(*pixels.values())[0, 1]
    rows = []
    for name, image in images.items():
        fired, r = image.response, image.outline_correlation(scan.study.stimulus)
        row = Row(name, int(fired.counts().sum()), float(fired.peak_rate().max()), r)
        print("{model:12}: {spikes} spikes, peak {peak_Hz:.0f}/s, r = {r:.2f}".format(**vars(row)))
        rows.append(row)
        save(fired, folder / f"{name}.npz")
    print(f"correlation of both images: {alike:.2f}")
    write_table(folder / "other_models.csv", rows)
    draw(images, folder / "other_models.png")


def draw(images: dict[str, RateImage], file: Path) -> None:
    """Draw the firing rates of both on one scale."""
    top = max(np.percentile(image.rate_Hz, 99.5) for image in images.values())
    figure, panels = plt.subplots(1, 2, figsize=(6.7, 2.9), sharey=True, layout="constrained")
    for axes, (name, image) in zip(panels, images.items(), strict=True):
        x, y = image.across_mm, image.along_mm
        shown = axes.pcolormesh(
            y, x, image.rate_Hz, vmin=0, vmax=top, cmap="magma", shading="nearest"
        )
        axes.set(title=name, xlabel="Displacement (mm)", aspect="equal", ylim=(x[-1], x[0]))
    panels[0].set_ylabel("X (mm)")
    figure.colorbar(shown, ax=panels, shrink=0.7, extend="max", label="Firing rate (spikes/s)")
    figure.savefig(file, dpi=200)


# %%
if __name__ == "__main__":
    run_script(main)
