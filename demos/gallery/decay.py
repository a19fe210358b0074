"""
Why firing decays: the skin or the receptor
===========================================

Hamasaki et al. (2020) could not say whether the firing of SA1 afferents decays in a hold because
the skin relaxes or because the receptor adapts. Here a cylinder of 6.35 mm radius is pressed 1 mm
deep and held for 5 s, with elastic and with relaxing tissue. Each history drives an afferent with
and one without adaptation.

.. figure:: /pictures/decay.png

   After 2 s the adaptation of the receptor divides the rate by 5.6, the relaxation of the tissue by
   1.3, both together by 8.1. In this model firing decays because the receptor adapts.

Expected time: 3 minutes on one core.

What to change: ``stimulus.radius_mm``; the times of the holds; ``adaptation`` and
``fast_adaptation``; other relaxation times, such as ``tissue.dermis.tau_s``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/decay.png'

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

from tactile_fem.neuron import Window, current_at, mean_rates, rate_of
from tactile_fem.series import run_all, sweep
from tactile_fem.study import Neuron

# %%
# Consecutive holds have longer and longer steps.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/decay")
holds = [(0.01, 6), (0.04, 6), (0.15, 6), (0.6, 6), (4.2, 6)]  # s, steps
path = ["{kind='press', depth_mm=1.0}"]
path += [f"{{kind='hold', time_s={s}, output_s={s / steps}}}" for s, steps in holds]
overrides = [
    "stimulus.kind=cylinder",
    "stimulus.radius_mm=6.35",
    f"protocol.path=[{', '.join(path)}]",
    "receptors.half_width_mm=0",
    "solver.max_press_step_mm=0.05",
    *sys.argv[2:],
]
members = sweep(["tissue.relaxation=none,fingerpad"], overrides=overrides)
names = "elastic", "relaxing"
scans = dict(zip(names, run_all(members, folder), strict=True))
traces = {name: scan.trace for name, scan in scans.items()}
elapsed = {name: trace["time_s"] - trace["time_s"][0] for name, trace in traces.items()}

# %%
# Gains are chosen so that all four afferents fire equally fast during the press.

ramp, held = Window(0.0, 0.05, 0.0), Window(2.0, 5.0, 0.0)


def rates(tissue: str, neuron: Neuron) -> np.ndarray:
    """Return the mean rates in the press and in the late hold, spikes/s."""
    felt = traces[tissue]["sed_kPa"]
    return mean_rates(elapsed[tissue], felt, [ramp, held], neuron)[:, 0]


def equally_fast(tissue: str, neuron: Neuron, wanted_Hz: float) -> Neuron:
    """Return the neuron with the gain that gives a rate in the press."""

    def with_gain(logarithm: float) -> Neuron:
        gain = np.exp(logarithm) * neuron.static_gain_pA_per_kPa
        return neuron.model_copy(update={"static_gain_pA_per_kPa": float(gain)})

    found = brentq(lambda x: rates(tissue, with_gain(x))[0] - wanted_Hz, -6.0, 3.0)
    return with_gain(found)


adapts = Neuron(static_gain_pA_per_kPa=1250.0)  # of a human afferent, twice the default
constant = adapts.model_copy(update={"fast_adaptation": 0.0, "adaptation": 0.0})
wanted_Hz = rates("elastic", adapts)[0]
models = {
    "neither": ("elastic", constant),
    "receptor adapts": ("elastic", adapts),
    "tissue relaxes": ("relaxing", constant),
    "both": ("relaxing", adapts),
}
models = {name: (skin, equally_fast(skin, n, wanted_Hz)) for name, (skin, n) in models.items()}
late = {name: rates(skin, neuron)[1] for name, (skin, neuron) in models.items()}
for name, rate in late.items():
    print(f"{name}: {rate:.0f} spikes/s after 2 s, divided by {late['neither'] / rate:.2f}")

# %%
# Force and strain energy density (SED) fall only if the tissue relaxes; the rate falls mostly if
# the receptor adapts.

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for name, dashes in zip(names, ("--", "-"), strict=True):
    force, sed = traces[name]["force_N"][:, 2], traces[name]["sed_kPa"][:, 0]
    left.plot(elapsed[name], force / force.max(), dashes, color="0.5", label=f"force, {name}")
    left.plot(elapsed[name], sed / sed.max(), dashes, color="C3", label=f"SED, {name}")
for name, (skin, neuron) in models.items():
    at = np.geomspace(1e-3, elapsed[skin][-1], 600)
    current = current_at(at, elapsed[skin], traces[skin]["sed_kPa"], neuron)
    right.plot(at, rate_of(current, neuron)[:, 0], label=name)
left.set(ylabel="Share of the largest")
right.set(ylabel="Firing rate (spikes/s)")
for axes in (left, right):
    axes.set(xlabel="Time since first touch (s)", xscale="log", ylim=(0, None))
    axes.legend(fontsize=8)
figure.savefig(folder / "decay.png", dpi=120)
