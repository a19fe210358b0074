"""
Vibration: tuning curves of RA and PC
=====================================

A probe of 1 mm is pressed 1 mm deep and held for 2 s in relaxing tissue. About this state the
finger vibrates at each frequency: one linear solution with inertia. A tuning curve is the amplitude
of the probe at which an afferent of median gain fires 10 spikes/s more than without vibration.
SA1 afferents are not drawn: they fire at 37 spikes/s after a hold of a minute and need at least
250 µm.

.. figure:: /pictures/vibration.png

   Lines: model; dots: monkeys. RA are most sensitive at 20 to 70 Hz (25 µm), PC at 300 Hz
   (0.16 µm). Near 150 Hz the tissue under the probe resonates, and the force on the probe halves.

Expected time: 5 minutes on one core.

What to change: the frequencies; ``protocol.path``, for the depth of the probe;
``finger.preset=medium`` above 300 Hz, where shear waves are shorter than two coarse elements.
"""

# sphinx_gallery_thumbnail_path = 'pictures/vibration.png'

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactile_fem import Study, completed, load_study, vibrate

# %%
# The flat end of the probe is one dot, so high that its plate does not touch.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/vibration")
below = {"placement": "line", "half_width_mm": 0.0}
kinds = [{"name": kind, "kind": kind, "receptors": below} for kind in ("SA1", "RA", "PC")]
overrides = [
    "tissue.relaxation=fingerpad",
    "stimulus.kind=dots",
    "stimulus.radius_mm=0.5",
    "stimulus.columns=1",
    "stimulus.rows=1",
    "stimulus.relief_mm=4",
    "stimulus.fillet_radius_mm=0.1",
    "stimulus.start_mm=0",
    "protocol.path=[{kind='press', depth_mm=1.0}, {kind='hold', time_s=2.0}]",
    *sys.argv[2:],
]
study = load_study(overrides=overrides).model_dump()
results = completed(Study.model_validate({**study, "afferents": kinds}), folder)
frequencies = [5.0, 10.0, 20.0, 33.0, 50.0, 70.0, 100.0, 150.0, 200.0, 250.0, 300.0, 400.0]
spectrum = vibrate(folder, frequencies)

# %%
# ``at_amplitudes`` treats many amplitudes as if they were receptors.

amplitudes_um = np.geomspace(0.02, 1000, 48)
thresholds = {}
for afferents in results.study.populations:
    population = afferents.population()
    median = {"gain_spread": 0.0, "threshold_noise": 0.0}
    population = replace(population, neuron=population.neuron.model_copy(update=median))
    receptor = int(np.flatnonzero(spectrum.population == population.name)[0])
    own = spectrum.at_amplitudes(receptor, amplitudes_um / 1000)
    rates = np.array([own.rates_Hz(k, 1.0, population) for k in range(len(frequencies))])
    fires = rates >= rates[:, :1] + 10.0
    found = [amplitudes_um[np.argmax(row)] if row.any() else np.nan for row in fires]
    thresholds[population.name] = np.array(found)
    print(
        f"{population.name}: {rates[:, 0].mean():.0f} spikes/s at rest, thresholds (µm) "
        + ", ".join(f"{f:g} Hz {t:.3g}" for f, t in zip(frequencies, found, strict=True))
    )

# %%
# Dots are thresholds recorded in monkeys (`Muniak et al. 2007
# <https://pmc.ncbi.nlm.nih.gov/articles/PMC6673240/>`_). The filters were fitted to their shape,
# not to their level.

measured = {
    "RA": {1: 507, 4: 128, 16: 53, 33: 47, 67: 55},
    "PC": {20: 6.0, 41: 1.4, 82: 0.32, 153: 0.087, 250: 0.052, 422: 0.054},
}
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
for kind, colour in zip(measured, ("C1", "C2"), strict=True):
    left.loglog(frequencies, thresholds[kind], color=colour, label=kind)
    left.loglog(*zip(*measured[kind].items(), strict=True), "o", color=colour)
left.set(xlabel="Frequency (Hz)", ylabel="Threshold (µm)")
left.legend()
for kind, felt in (("RA", spectrum.stretches[..., 0]), ("PC", spectrum.moved[..., 2])):
    receptor = int(np.flatnonzero(spectrum.population == kind)[0])
    right.semilogx(frequencies, np.abs(felt[:, receptor]), label=f"felt by {kind}")
right.semilogx(frequencies, np.abs(spectrum.force_N @ spectrum.motion), "k--", label="force (N/mm)")
right.set(xlabel="Frequency (Hz)", ylabel="Amplitude per mm of the probe", ylim=(0, None))
right.legend()
figure.savefig(folder / "vibration.png", dpi=120)
