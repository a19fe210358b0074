"""
Fingerprints on an edge
=======================

A section of the finger in plane strain, with and without fingerprints and dermal papillae, slides
over an edge 0.3 mm high. Ridges stick and slip one by one: force and strain energy density (SED)
oscillate at the frequency speed/pitch.

.. figure:: /pictures/fingerprints.png

   The amplitude at one period per ridge is 4.4 % of the mean SED, 0.2 % in smooth skin. Whenever a
   ridge slips, the tangential force falls by a quarter.

Expected time: 6 minutes on one core. It needs the extra ``mesh``.

What to change: ``protocol.speed_mm_s``, ``stimulus.friction``, ``finger.ridge_height_mm``,
``finger.papilla_depth_mm``; a grating is ``stimulus.count=12`` with ``stimulus.groove_mm``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/fingerprints.png'

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactile_fem import load_study
from tactile_fem.series import Member, mean_over, run_all

# %%
# Receptors lie at the tips of intermediate ridges, or on a line in smooth skin. The force of a
# section is per mm of its width.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/fingerprints")
PITCH_MM = 0.47
ridged = [
    "finger.ridge_height_mm=0.1",
    "finger.papilla_depth_mm=0.2",
    "receptors.placement=intermediate_ridges",
]
smooth = ["receptors.placement=line", f"receptors.spacing_mm={PITCH_MM / 2}"]
common = [
    "finger.kind=section",
    f"finger.ridge_pitch_mm={PITCH_MM}",
    "finger.ridged_half_length_mm=5",
    f"finger.pad_size_mm={PITCH_MM / 8}",
    "stimulus.kind=grating",
    "stimulus.count=1",
    "stimulus.ridge_mm=1",
    "stimulus.relief_mm=0.3",
    "stimulus.fillet_radius_mm=0.1",
    "stimulus.start_mm=-1.5",
    "protocol.force_N=0.06",
    "protocol.press_speed_mm_s=5",
    "protocol.distance_mm=3",
    "receptors.average_radius_mm=0.03",
    "solver.linear=direct",
    "solver.contact_width_MPa=0.02",
    "solver.max_slide_step_mm=0.1",
]
skins = {"smooth": smooth, "ridged": ridged}
members = [
    Member(name, load_study(overrides=[*common, *skin, *sys.argv[2:]]), {})
    for name, skin in skins.items()
]
scans = dict(zip(skins, run_all(members, folder), strict=True))

# %%
# The amplitude comes from the mean history near the contact point.


def near(results) -> np.ndarray:
    """Return the receptors within 1.5 mm of the contact point."""
    return np.flatnonzero(np.abs(results.trace["receptors_mm"][:, 1]) < 1.5)


def wave(at_mm: np.ndarray, sed_kPa: np.ndarray) -> float:
    """Return the amplitude of SED at the rhythm of the ridges over its mean."""
    even = np.linspace(at_mm[0], at_mm[-1], 400)
    values = np.array([np.interp(even, at_mm, column) for column in sed_kPa.T])
    values -= np.array([np.polyval(np.polyfit(even, own, 4), even) for own in values])
    window = np.hanning(400) / np.hanning(400).sum()
    amplitude = 2 * np.abs((window * values) @ np.exp(-2j * np.pi * even / PITCH_MM))
    return float(np.sqrt(np.mean(amplitude**2)) / mean_over(at_mm, sed_kPa).mean())


figure, (felt, pulled) = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
for name, results in scans.items():
    trace, own = results.trace, near(results)
    slide = trace["displacement_mm"] > 0
    at, force = trace["displacement_mm"][slide], -trace["force_N"][slide, 1]
    sed = trace["sed_kPa"][slide]
    late = at > at[-1] / 6
    print(
        f"{name}: SED {mean_over(at[late], sed[late][:, own]).mean():.3f} kPa, its wave "
        f"{100 * wave(at[late], sed[late][:, own]):.1f} %, tangential force "
        f"{mean_over(at[late], force[late]):.4f} N/mm"
    )
    middle = np.argmin(np.abs(trace["receptors_mm"][:, 1]))
    felt.plot(at, sed[:, middle], label=name)
    pulled.plot(at, force, label=name)
felt.set(ylabel="SED at the middle (kPa)", ylim=(0, None))
pulled.set(xlabel="Displacement (mm)", ylabel="Tangential force (N/mm)", ylim=(0, None))
felt.legend()
figure.savefig(folder / "fingerprints.png", dpi=120)
