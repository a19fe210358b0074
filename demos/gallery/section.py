"""
A section beside the solid finger
=================================

A section in plane strain costs a tenth of the solid finger. Both slide over the same three bars,
the solid finger pressed to 0.6 N, the section to 0.06 N/mm. The section has the same maxima in
the same order, but too little strain energy density (SED), and it ignores what lies beside its
plane: use it for parameter studies and ridges, not for letters and rates.

.. figure:: /pictures/section.png

   Maxima of the section come 0.3 mm later, with 0.57 times the largest SED of the solid finger.
   The histories correlate by 0.88.

Expected time: 22 minutes on one core of a busy machine, 2 of them for the section.

What to change: ``stimulus.ridge_mm``, ``stimulus.groove_mm``; ``finger.plane=transverse``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/section.png'

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import find_peaks

from tactile_fem import load_study
from tactile_fem.series import Member, run_all

# %%
# The force is the same: 0.6 N over a contact 10 mm wide.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/section")
force_N = {"solid": 0.6, "section": 0.06}
members = []
for kind, force in force_N.items():
    overrides = [
        f"finger.kind={kind}",
        "stimulus.kind=grating",
        "stimulus.count=3",
        "stimulus.ridge_mm=1.5",
        "stimulus.groove_mm=2.5",
        f"protocol.force_N={force}",
        "protocol.press_speed_mm_s=5",
        "protocol.output_mm=0.2",
        *sys.argv[2:],
    ]
    members.append(Member(kind, load_study(overrides=overrides), {}))
scans = dict(zip(force_N, run_all(members, folder), strict=True))

# %%
# Each history is drawn relative to its largest value.

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
histories = []
for kind, results in scans.items():
    trace = results.trace
    slide = trace["displacement_mm"] > 0
    middle = np.argmin(np.linalg.norm(trace["receptors_mm"][:, :2], axis=1))
    at, sed = trace["displacement_mm"][slide], trace["sed_kPa"][slide, middle]
    histories.append((at, sed))
    peaks = ", ".join(f"{place:.1f}" for place in at[find_peaks(sed, prominence=0.05)[0]])
    print(
        f"{kind}: {trace['depth_mm'].max():.2f} mm deep, SED at most {sed.max():.2f} kPa, "
        f"maxima at {peaks} mm, {trace['wall_s'].sum():.0f} s"
    )
    axes.plot(at, sed / sed.max(), label=f"{kind}, at most {sed.max():.2f} kPa")
(at, sed), section = histories
print(f"correlation of the histories {np.corrcoef(sed, np.interp(at, *section))[0, 1]:.2f}")
axes.set(xlabel="Displacement (mm)", ylabel="SED over its maximum", ylim=(0, None))
axes.legend()
figure.savefig(folder / "section.png", dpi=120)
