"""
Your own stimulus, path and afferents
=====================================

A raised ring moves in a circle over the finger; afferents respond to changes of shear in the
tissue. Stimulus, piece of the path, drive and transduction take a few lines each.

.. figure:: /pictures/own_stimulus.png

   Shear of up to 0.065 and 991 spikes while the ring is pressed, moved in a circle and lifted.

Expected time: 1 minute on one core.

What to change: ``stimulus.radius_mm``; the pieces of the path; the field that the afferents feel.
A study file can name code in a ``shapes.py`` beside it: ``stimulus.kind = "heights"`` with
``stimulus.z = "shapes:waves"``, heights as a function of X and Y, and ``feels = "shapes:shear"``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/own_stimulus.png'

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
from pydantic import Field as Key

from tactile_fem import (
    Distance,
    Embossed,
    Motion,
    Parts,
    Piece,
    Population,
    Results,
    Stimulus,
    load_study,
    scan,
)
from tactile_fem.neuron import DRIVES, Drive, ExponentialSum, Field, Segment

# %%
# **Stimulus.** A kind of stimulus has keys and a shape: signed distance, gradient and Hessian, here
# in the plane, from which `Embossed` raises it with a fillet. The Lipschitz constant of the
# distance must be at most 1, because skin that has moved less than its gap is not evaluated again.


@dataclass(frozen=True)
class Annulus:
    """The flat shape that is raised."""

    radius: float
    width: float

    def distance(self, xy):
        """Return the signed distance in the plane at xy (n, 2), negative inside."""
        r = np.maximum(np.linalg.norm(xy, axis=1), 1e-9)
        n = xy / r[:, None]
        H = (np.eye(2) - n[:, :, None] * n[:, None, :]) / r[:, None, None]
        side = np.where(r < self.radius, -1.0, 1.0)
        gap = np.abs(r - self.radius) - self.width / 2
        return Distance(gap, side[:, None] * n, side[:, None, None] * H)


class Ring(Stimulus):
    """A ring raised by 0.6 mm from a plate."""

    kind: Literal["ring"] = "ring"
    radius_mm: float = Key(2.0, gt=0, description="mean radius")
    width_mm: float = Key(1.0, gt=0, description="from edge to edge")

    def shape(self):
        """Return the body, its highest plane at z = 0."""
        return Embossed(Annulus(self.radius_mm, self.width_mm), relief=0.6, fillet=0.3)


# %%
# **Path.** A kind of piece returns its motion, from where the body is, and the times of output.


class Circle(Piece):
    """A circle through the place where the piece begins."""

    kind: Literal["circle"] = "circle"
    circle_mm: float = Key(1.5, gt=0, description="radius")
    speed_mm_s: float = Key(20.0, gt=0, description="along the circle")

    def motion(self, start_mm):
        """Return the motion from start_mm (3,)."""
        duration_s = 2 * np.pi * self.circle_mm / self.speed_mm_s

        def place(t):
            angle = 2 * np.pi * t / duration_s
            return start_mm + self.circle_mm * np.array([np.sin(angle), 1 - np.cos(angle), 0.0])

        return Motion("circle", duration_s, place, np.linspace(0, duration_s, 33)[1:])


# %%
# **Drive and transduction.** A field is a UFL expression of the tissue at a point, which becomes a
# column of the trace. A transduction yields the current of each step as a line plus exponentials.


def shear_of(point):
    """Return the shear strain between Y and Z, in UFL."""
    F = point.deformation_gradient
    return (F.T * F)[1, 2] / 2


field = Field("shear_strain_yz", shear_of)
shear = Drive("Shear", "1", lambda trace: np.abs(trace["shear_strain_yz"]), fields=(field,))
DRIVES["shear"] = shear  # now `feels` in a study may be "shear" or "shear_rate"


@dataclass(frozen=True)
class Changes:
    """The current is gain |dS/dt|, with the gain in pA s."""

    gain: float

    def segments(self, time_s, drive):
        """Yield the current of each step, in pA."""
        for k, h in enumerate(np.diff(time_s)):
            current = self.gain * np.abs(drive[k + 1] - drive[k]) / h
            none = np.empty((0, len(current))), np.empty(0)
            yield Segment(time_s[k], h, ExponentialSum(current, 0 * current, *none))


# %%
# Kinds of stimulus and path belong to the study; other parts are passed separately. Populations
# replace those of the same name.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/own_stimulus")
path = "{kind='press', depth_mm=1.2}, {kind='circle'}, {kind='lift', speed_mm_s=20.0}"
overrides = [
    "finger.pad_size_mm=3",
    "finger.far_size_mm=6",
    "stimulus.kind=ring",
    f"protocol.path=[{path}]",
    *sys.argv[2:],
]
parts = Parts(populations=(Population(feels=shear, transduction=Changes(gain=200.0)),))
scan(load_study(overrides=overrides), folder, parts=parts)
results = Results.open(folder)
trace, spikes = results.trace, results.spikes
way = trace["displacement_mm"][trace["phase"] == "circle"]
print(f"circle of {way[-1]:.2f} mm, largest shear {trace['shear_strain_yz'].max():.3f}")
print(f"{len(spikes.time_s)} spikes")

# %%
# Shear at the line of receptors over time, with the spikes.

figure, axes = plt.subplots(figsize=(8, 3.8), layout="constrained")
x, felt = trace["receptors_mm"][:, 0], trace["shear_strain_yz"].T
largest = np.abs(felt).max()
shown = axes.pcolormesh(trace["time_s"], x, felt, cmap="PuOr", vmin=-largest, vmax=largest)
axes.plot(spikes.time_s, x[spikes.receptor], "k.", ms=2)
axes.set(xlabel="Time (s)", ylabel="X of the receptor (mm)", ylim=(x.max(), x.min()))
figure.colorbar(shown, ax=axes, label="Shear strain YZ")
figure.savefig(folder / "own_stimulus.png", dpi=120)
