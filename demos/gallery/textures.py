"""
Sandpaper and woven cloth
=========================

A finger strokes two height maps, sandpaper and a plain weave, with 0.5 N.

.. figure:: /pictures/textures.png

   Receptors feel high grains one by one, and threads across the finger all together. The SED of
   the middle receptor varies by 49 % on sandpaper and by 20 % on cloth.

Expected time: 6 minutes on one core.

What to change: ``stimulus.file``, your own map; ``finger.preset=medium``, which follows waves from
1.1 mm on, the coarse finger from 1.9 mm on; ``protocol.hold=force``, which keeps the force instead
of the depth; ``stimulus.kind=braille`` with ``stimulus.text``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/textures.png'

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactile_fem import completed, load_study
from tactile_fem.series import mean_over

# %%
# A map has rows along X and columns along Y. The sandpaper is a Gaussian random field, the cloth
# consists of round threads.

SPACING_MM = 0.025


def sandpaper(grain_mm: float, rms_um: float) -> np.ndarray:
    """Return heights of 12.8 x 25.6 mm, um, correlated over half a grain."""
    shape = 512, 1024
    waves = np.meshgrid(*(np.fft.fftfreq(n, SPACING_MM) for n in shape), indexing="ij")
    amplitude = np.exp(-((np.pi * np.hypot(*waves) * grain_mm) ** 2) / 8)
    white = np.random.default_rng(1).normal(size=shape)
    heights = np.fft.ifft2(np.fft.fft2(white) * amplitude).real
    return rms_um * (heights - heights.mean()) / heights.std()


def cloth(pitch_mm: float, height_um: float) -> np.ndarray:
    """Return one repeat of a plain weave, two threads each way, um."""
    count = round(2 * pitch_mm / SPACING_MM)
    x, y = np.meshgrid(*2 * [np.arange(count) / count * 2], indexing="ij")  # in threads

    def thread(across: np.ndarray, along: np.ndarray, first: float) -> np.ndarray:
        number, off = np.round(across), across - np.round(across)
        wave = first * np.cos(np.pi * number) * np.cos(np.pi * along)
        return (wave + np.sqrt(np.maximum(1 - (off / 0.48) ** 2, 0))) / 2

    return height_um * np.maximum(thread(x, y, 1.0), thread(y, x, -1.0))


# %%
# The study scales the file to mm and filters out waves too short for the skin; the map repeats.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/textures")
folder.mkdir(parents=True, exist_ok=True)
maps = {"sandpaper": sandpaper(1.0, 60.0), "cloth": cloth(2.4, 350.0)}
scans = {}
for name, heights in maps.items():
    np.save(folder / f"{name}.npy", heights)
    overrides = [
        "stimulus.kind=surface",
        f"stimulus.file={folder / name}.npy",
        f"stimulus.spacing_mm={SPACING_MM}",
        "stimulus.unit_mm=0.001",
        "stimulus.low_pass_mm=0.3",
        "stimulus.repeat=periodic",
        "protocol.force_N=0.5",
        "protocol.distance_mm=7",
        *sys.argv[2:],
    ]
    scans[name] = results = completed(load_study(overrides=overrides), folder / name)
    trace = results.trace
    slide = trace["phase"] == "slide"
    time_s, pulled = trace["time_s"][slide], -trace["force_N"][slide, 1]
    sed = trace["sed_kPa"][slide, np.argmin(np.abs(trace["receptors_mm"][:, 0]))]
    mean = mean_over(time_s, sed)
    sd = np.sqrt(mean_over(time_s, (sed - mean) ** 2))
    print(
        f"{name}: tangential force {mean_over(time_s, pulled):.3f} N, SED of the middle "
        f"receptor {mean:.2f} kPa, varies by {100 * sd / mean:.0f} %, "
        f"{len(results.spikes.time_s)} spikes"
    )

# %%
# The strain energy density (SED) at the line of receptors, and their spikes.

figure, grid = plt.subplots(2, 2, figsize=(10, 6), sharex=True, sharey=True, layout="constrained")
for (felt, fired), (name, results) in zip(grid.T, scans.items(), strict=True):
    trace, spikes = results.trace, results.spikes
    slide = trace["phase"] == "slide"
    at, x = trace["displacement_mm"][slide], trace["receptors_mm"][:, 0]
    shown = felt.pcolormesh(at, x, trace["sed_kPa"][slide].T, cmap="magma", shading="nearest")
    figure.colorbar(shown, ax=felt, label="SED (kPa)")
    sliding = spikes.time_s > 0
    fired.plot(spikes.displacement_mm[sliding], x[spikes.receptor[sliding]], "k.", ms=2)
    felt.set(title=name, ylim=(x[-1], x[0]))
    fired.set(xlabel="Displacement (mm)", xlim=(0, at[-1]))
for axes in grid[:, 0]:
    axes.set_ylabel("X (mm)")
figure.savefig(folder / "textures.png", dpi=110)
