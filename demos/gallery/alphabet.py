"""
Recognizing letters in spikes
=============================

Each letter of the alphabet is scanned once. Its history of strain energy density drives ten
populations with varying gains (by 30 %) and thresholds (by 10 %). A reader compares each image of
firing with the mean images of the letters over the other populations, allowing shifts of 1 mm.
Without noise it would recognize every letter; with noise of 370 spikes/s in each pixel it
recognizes half of them, as naive people do (`Vega-Bermudez et al. 1991
<https://doi.org/10.1152/jn.1991.65.3.531>`_).

.. figure:: /pictures/alphabet.png

   Left: mean images of firing. Right: how often a letter (row) is taken for another (column).
   Of 1,300 images 49 % are recognized; I and J, O and Q are confused in 31 %.

Expected time: 1 minute if ``demos/gallery/scans.zip`` of the repository lies beside the script or
notebook; without it, or with changes, two hours for 26 scans.

What to change: ``NOISE_HZ``; ``gain_spread``; a key of the study, such as ``protocol.depth_mm``;
``stimulus.kind=braille`` with ``protocol.force_N``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/alphabet.png'

import sys
import zipfile
from pathlib import Path
from string import ascii_uppercase as letters

import matplotlib.pyplot as plt
import numpy as np

from tactile_fem.series import correlations, population_image, run_all, sweep

# %%
# The archive holds the histories; scans that are missing are run.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/alphabet")
changes = sys.argv[2:]
archive = Path(globals().get("__file__", "")).parent / "scans.zip"  # notebooks have no __file__
if archive.is_file() and not changes:
    with zipfile.ZipFile(archive) as shipped:
        shipped.extractall(folder, [n for n in shipped.namelist() if n.startswith("letters/")])
members = sweep(
    [f"stimulus.text={','.join(letters)}"], overrides=["protocol.output_mm=0.2", *changes]
)
scans = run_all(members, folder / "letters")
neuron = members[0].study.neuron

# %%
# The k-th images of all letters come from one population, which the templates must not contain.

POPULATIONS, READINGS, NOISE_HZ = 10, 5, 370.0
rates = np.empty(0)
for number, results in enumerate(scans):
    for k in range(POPULATIONS):
        varied = {"gain_spread": 0.3, "threshold_noise": 0.1, "seed": k + 1}
        image = population_image(results, neuron.model_copy(update=varied))
        if not rates.size:
            rates = np.empty((len(letters), POPULATIONS, *image.rate_Hz.shape))
        rates[number, k] = image.rate_Hz
random = np.random.default_rng(1)
written = np.tile(np.arange(len(letters)), READINGS)
confusion = np.zeros((len(letters), len(letters)))
for k in range(POPULATIONS):
    templates = np.delete(rates, k, axis=1).mean(axis=1)
    seen = rates[written, k]
    seen = seen + NOISE_HZ * random.normal(size=seen.shape)
    read = correlations(seen, templates, (5, 5)).argmax(axis=1)
    np.add.at(confusion, (written, read), 1 / (POPULATIONS * READINGS))

# %%
# Letters that share their strokes are confused, most often I and J, O and Q, F and P; W and A are
# easy.

count = len(letters) * POPULATIONS * READINGS
print(f"{100 * np.trace(confusion) / len(letters):.0f} % of {count} recognized")
order = np.argsort(np.diag(confusion))
print("hardest", *(f"{letters[k]} {100 * confusion[k, k]:.0f} %" for k in order[:6]))
print("easiest", *(f"{letters[k]} {100 * confusion[k, k]:.0f} %" for k in order[:-7:-1]))
mistaken = confusion + confusion.T
pairs = sorted(zip(*np.triu_indices(len(letters), 1), strict=True), key=lambda p: -mistaken[p])
print("confused", *(f"{letters[i]}{letters[j]} {50 * mistaken[i, j]:.0f} %" for i, j in pairs[:6]))

figure = plt.figure(figsize=(11, 5), layout="constrained")
images, matrix = figure.subfigures(1, 2, width_ratios=(1.25, 1))
for axes, letter, own in zip(images.subplots(5, 6).flat, letters, rates.mean(axis=1), strict=False):
    axes.imshow(own, cmap="magma", aspect="equal")
    axes.set_title(letter, fontsize=9, pad=2)
for axes in images.axes:
    axes.set_axis_off()
axes = matrix.subplots()
shown = axes.imshow(100 * confusion, cmap="magma")
axes.set_xticks(range(len(letters)), letters, fontsize=7)
axes.set_yticks(range(len(letters)), letters, fontsize=7)
axes.set(xlabel="Recognized as", ylabel="Letter")
matrix.colorbar(shown, ax=axes, label="Share of the images (%)", shrink=0.8)
figure.savefig(folder / "alphabet.png", dpi=110)
