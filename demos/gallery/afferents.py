"""
One letter, three kinds of afferents
====================================

SA1 afferents (strain energy density at the epidermis), RA afferents (rate of compression in the
papillae) and PC afferents (acceleration, 2 mm deep) respond to a G. All lie on a line 0.2 mm
apart, more densely than in a finger, so that their images can be compared. SA1 afferents show
the letter best, as in recordings (`Phillips, Johnson and Hsiao 1988
<https://doi.org/10.1073/pnas.85.4.1317>`_).

Expected time: 3 minutes on one core.

What to change: ``stimulus.text``; ``protocol.speed_mm_s``; a population, such as ``{name='SA1',
kind='SA1', feels='von_mises'}``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/afferents.png'

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactile_fem import Study, completed, draw_raster, load_study
from tactile_fem.series import population_image

# %%
# This scan has no inertia and steps of 5 ms, so the PC afferents respond to abrupt changes only.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/afferents")
populations = [{"name": kind, "kind": kind} for kind in ("SA1", "RA", "PC")]
study = load_study(
    overrides=["stimulus.text=G", "protocol.output_mm=0.2", *sys.argv[2:]]
).model_dump()
results = completed(Study.model_validate({**study, "afferents": populations}), folder)
images = {kind: population_image(results, population=kind) for kind in ("SA1", "RA", "PC")}

# %%
# ``outline_correlation`` compares an image of firing with the outline of the letter.

stimulus = results.study.stimulus
for kind, image in images.items():
    spikes, r = image.response.counts().sum(), image.outline_correlation(stimulus)
    print(f"{kind}: {spikes} spikes, r = {r:.2f}")

# %%
# All kinds share a scale of rates, which one pixel in a hundred exceeds.

every = np.concatenate([image.rate_Hz.ravel() for image in images.values()])
scale = {"vmin": 0.0, "vmax": np.percentile(every[every > 0], 99), "cmap": "magma"}
plt.rcParams["font.size"] = 8
figure, panels = plt.subplots(1, 3, figsize=(6.7, 2.3), sharey=True, layout="constrained")
for axes, (kind, image) in zip(panels, images.items(), strict=True):
    x, y = image.across_mm, image.along_mm
    shown = axes.pcolormesh(y, x, image.rate_Hz, shading="nearest", **scale)
    for shape in stimulus.outlines():
        axes.plot(*shape.exterior.xy[::-1], color="white", lw=0.8)
    axes.set(title=kind, xlabel="Displacement (mm)", aspect="equal", ylim=(x[-1], x[0]))
panels[0].set_ylabel("X (mm)")
figure.colorbar(shown, ax=panels, shrink=0.8, extend="max", label="Firing rate (spikes/s)")
figure.savefig(folder / "afferents.png", dpi=200)

# %%
# The spikes of all by kind; `draw_psth` and `draw_rates` take the same.

draw_raster(results.response, results.trace["population"]).savefig(folder / "raster.png")

# %%
# .. figure:: /pictures/afferents.png
#
#    SA1 afferents show the letter (r = 0.61 with its outline), RA afferents its leading edges
#    (0.33), PC afferents that something moves (0.07). Gains of RA and PC afferents vary from row
#    to row.
