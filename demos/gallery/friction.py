"""
Friction drags the skin
=======================

The letter G is scanned with friction coefficients of 0, 0.3 and 1. Friction shears the pad,
increases the strain energy density (SED) and delays the response, because the skin is dragged
along before it slips.

.. figure:: /pictures/friction.png

   A coefficient of 1 more than doubles the largest SED (6.7 kPa, without friction 3.0 kPa) and
   delays the response by more than 2 mm. The correlation of firing with the outline falls
   from 0.68 to 0.35.

Expected time: 8 minutes on one core, 4 with ``jobs=2``.

What to change: the values of ``stimulus.friction`` in the sweep; ``stimulus.text``;
``protocol.speed_mm_s``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/friction.png'

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactile_fem.series import numbers_of, population_image, run_all, sweep, write_summary

# %%
# ``sweep`` makes one study for each value; ``run_all`` runs those that are not complete, each in
# its own folder.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/friction")
overrides = ["stimulus.text=G", "protocol.output_mm=0.2", *sys.argv[2:]]
members = sweep(["stimulus.friction=0,0.3,1"], overrides=overrides)
scans = run_all(members, folder, jobs=1)
write_summary(members, folder)

# %%
# ``outline_correlation`` compares the image of firing with the outline of the letter.

for results in scans:
    stimulus, numbers = results.study.stimulus, numbers_of(results)
    image = population_image(results)
    print(
        f"friction {stimulus.friction:g}: {numbers['normal_N']:.3f} N, "
        f"{numbers['tangential_N']:.3f} N tangential, SED at most "
        f"{numbers['largest_sed_kPa']:.2f} kPa, {image.response.counts().sum()} spikes, "
        f"r = {image.outline_correlation(stimulus):.3f}"
    )

# %%
# The upper panel is the SED of the receptor above the contact point, the lower one the ratio of
# tangential to normal force.

figure, (felt, pulled) = plt.subplots(2, 1, figsize=(7, 5), sharex=True, layout="constrained")
for results, shade in zip(scans, ("0.7", "0.4", "0.0"), strict=True):
    trace = results.trace
    slide = trace["phase"] == "slide"
    at, force = trace["displacement_mm"][slide], trace["force_N"][slide]
    middle = np.argmin(np.linalg.norm(trace["receptors_mm"][:, :2], axis=1))
    label = f"friction {results.study.stimulus.friction:g}"
    felt.plot(at, trace["sed_kPa"][slide, middle], color=shade, label=label)
    pulled.plot(at, -force[:, 1] / force[:, 2], color=shade)
felt.set(ylabel="SED (kPa)", ylim=(0, None))
pulled.set(xlabel="Displacement (mm)", ylabel="Tangential / normal force", ylim=(0, None))
felt.legend()
figure.savefig(folder / "friction.png", dpi=120)
