"""
One fibre in many passes, or a population in one
================================================

In recordings from single fibres, a letter is shifted between passes over one receptor; its spikes
form a spatial event plot. A population in one pass gives a poorer image, as Hamasaki et
al. (2020) found, because receptors at the side of a round finger carry less load.

.. figure:: /pictures/passes.png

   The image of one fibre correlates with the outline by 0.755, that of the population by 0.615.

Expected time: seconds if ``demos/gallery/scans.zip`` of the repository lies beside the script or
notebook; without it, or with changes, one hour for 25 scans.

What to change: ``spacing_mm``; a key of the study, such as ``stimulus.text``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/passes.png'

import sys
import zipfile
from pathlib import Path

import matplotlib.pyplot as plt

from tactile_fem import Results, completed, load_study
from tactile_fem.series import fibre_image, population_image, run_all, single_fibre

# %%
# The scan of the population serves as the pass without a shift.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/passes")
changes = sys.argv[2:]
archive = Path(globals().get("__file__", "")).parent / "scans.zip"  # notebooks have no __file__
study = load_study(overrides=["stimulus.text=G", "protocol.output_mm=0.2", *changes])
wanted = [m for m in single_fibre(study, spacing_mm=0.4) if m.values["shift_mm"]]
if archive.is_file() and not changes:
    with zipfile.ZipFile(archive) as shipped:
        names = [n for n in shipped.namelist() if n.startswith(("passes/", "letters/text-G/"))]
        shipped.extractall(folder, names)
    population = Results.open(folder / "letters/text-G")
else:
    population = completed(study, folder / "letters/text-G")
passes = [population, *run_all(wanted, folder / "passes")]

# %%
# Both images have one row for each position across the letter, and the neurons of ``study``.

images = {"51 receptors, one pass": population_image(population, study.neuron)}
images[f"one receptor, {len(passes)} passes"] = fibre_image(passes, study.neuron)
figure, panels = plt.subplots(1, 2, figsize=(9, 4.4), sharey=True, layout="constrained")
for axes, (name, image) in zip(panels, images.items(), strict=True):
    row, time_s = image.response.events()
    r = image.outline_correlation(study.stimulus)
    print(f"{name}: {len(time_s) / len(image.across_mm):.1f} spikes a row, r = {r:.3f}")
    axes.plot(study.protocol.speed_mm_s * time_s, image.across_mm[row], "k.", ms=2)
    for shape in study.stimulus.outlines():
        axes.plot(*shape.exterior.xy[::-1], color="C1", lw=1)
    axes.set(title=name, xlabel="Displacement (mm)", aspect="equal", xlim=(0, 10), ylim=(5, -5))
panels[0].set_ylabel("X on the letter (mm)")
figure.savefig(folder / "passes.png", dpi=120)
