# %% [markdown]
# # Measured and modelled rates under bar, spheres, punch and grating
#
#     python demos/validation/rates_figure.py results/rates.png

# %%
from pathlib import Path

import numpy as np
import recordings
from calibrate import modelled
from felt_quantities import FELT
from human_afferents import HumanAfferent
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from recordings import HOLD, RAMP, measured

from tactile_fem import run_script
from tactile_fem.neuron import Drive, Window, mean_rates
from tactile_fem.study import Neuron

BLUE, ORANGE, GREEN, INK = "#0072B2", "#D55E00", "#009E73", "#222222"


# %%
def main(picture: Path) -> None:
    """Draw the experiments side by side, with the default neuron."""
    figure = Figure(figsize=(12, 3.4), layout="constrained")
    panels = figure.subplots(1, 4)
    drawings = _draw_bar, _draw_spheres, _draw_people, _draw_grating
    for axes, draw in zip(panels, drawings, strict=True):
        draw(axes, Neuron(), FELT["sed"])
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_ylim(0, None)
    panels[0].set_ylabel("Firing rate (spikes/s)")
    figure.savefig(picture, dpi=120)


def _draw_bar(axes: Axes, neuron: Neuron, drive: Drive) -> None:
    table = measured("bar")
    y = np.round(np.arange(-30, 31) * 0.1, 6)
    felt = recordings.Felt.of("bar", drive)
    windows = [Window(*when, 0 * y) for when in (RAMP, HOLD)]
    model = mean_rates(*felt.held(felt.along(y)), windows, neuron)
    axes.axvspan(-1.5, 1.5, color="#E6E3DC", lw=0, zorder=0)
    for rates, (key, color) in zip(model, (("ramp_Hz", ORANGE), ("hold_Hz", BLUE)), strict=True):
        axes.plot(y, rates, color=color, label=f"{key[:4]}, model")
        axes.plot(table["y_mm"], table[key], "o", color=color, mfc="white", label="measured")
    axes.set(xlabel="From the bar's centre (mm)", title="Bar, fitted")
    axes.set_ylim(0, 1.35 * table["ramp_Hz"].max())
    axes.legend(frameon=False, fontsize=7, ncols=2, loc="upper center")


def _draw_spheres(axes: Axes, neuron: Neuron, drive: Drive) -> None:
    table = measured("spheres")
    model = modelled(recordings.spheres(drive), neuron)
    for force, color in zip(np.unique(table["force_N"]), (BLUE, GREEN, ORANGE), strict=True):
        mine = table["force_N"] == force
        curvature = table["curvature_per_m"][mine]
        axes.plot(curvature, model[mine], color=color, label=f"{force:g} N, model")
        rates = table["first_second_Hz"][mine]
        axes.plot(curvature, rates, "o", color=color, mfc="white")
    axes.plot([], [], "o", color=INK, mfc="white", label="measured")
    axes.set(xlabel="Curvature of the sphere (1/m)", title="Spheres, first second, fitted")
    axes.legend(frameon=False, fontsize=7)


def _draw_people(axes: Axes, neuron: Neuron, drive: Drive) -> None:
    for name, marker in (("b", "o"), ("a", "^")):
        unit = HumanAfferent.of(drive, neuron, name, recordings.PUNCH_MM)
        depth = measured(f"unit_{name}")["depth_mm"]
        parts = zip(
            unit.model_Hz, unit.measured_Hz, (ORANGE, BLUE), ("first 0.12", "late"), strict=True
        )
        for model, rates, color, label in parts:
            axes.plot(depth, model, color=color)
            told = f"{label} s, {name}" if label != "late" else f"0.5 to 0.95 s, {name}"
            axes.plot(depth, rates, marker, color=color, mfc="white", label=told)
    axes.set(xlabel="Depth of the punch (mm)", title="Two human afferents")
    axes.legend(frameon=False, fontsize=7)


def _draw_grating(axes: Axes, neuron: Neuron, drive: Drive) -> None:
    table = measured("grating")
    model = modelled(recordings.grating(drive), neuron)
    axes.plot(table["y_mm"], model, "s", color=BLUE, label="hold, model")
    axes.plot(table["y_mm"], table["hold_Hz"], "o", color=INK, mfc="white", label="measured")
    axes.set(xlabel="Place on the grating (mm)", title="Grating, predicted")
    axes.legend(frameon=False, fontsize=7)


# %%
if __name__ == "__main__":
    run_script(main)
