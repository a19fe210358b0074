"""Figures of how firing decays in a hold and in a slide; used by `decay.py`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from tactile_fem.neuron import Histories, Response, current_at, rate_of
from tactile_fem.output.annotations import BLUE, GREEN, INK, VERMILION
from tactile_fem.output.histories import central_receptor
from tactile_fem.output.plots import styled
from tactile_fem.study import Neuron

COLOURS = {"neither": INK, "receptor": BLUE, "tissue": VERMILION, "both": GREEN}
_DASHES = {"none": "--", "fingerpad": "-"}
_NAMES = {"none": "elastic", "fingerpad": "relaxing"}
_FIRST_S = 1e-3  # of the logarithmic axis
_WINDOW_MM = 0.5


class Model(Protocol):
    """Tissue and receptor of an afferent."""

    tissue: str
    neuron: Neuron

    def fires(self, trace: Histories) -> Response:
        """Return the spikes of all afferents."""


def elapsed(trace: Histories) -> np.ndarray:
    """Return the times since first touch, s."""
    return trace["time_s"] - trace["time_s"][0]


def middle_sed(trace: Histories) -> np.ndarray:
    """Return what the middle receptor feels, kPa, (t,)."""
    return trace["sed_kPa"][:, central_receptor(trace["receptors_mm"])]


@styled
def hold_figure(models: Mapping[str, Model], presses: Mapping[str, Histories]) -> Figure:
    """Draw force and drive, and the middle afferent's rate, over the time since first touch."""
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    felt, fired = figure.subplots(1, 2)
    for tissue, trace in presses.items():
        time = elapsed(trace)
        for values, name, colour in (
            (trace["force_N"][:, 2], "force", INK),
            (middle_sed(trace), "SED", VERMILION),
        ):
            label = f"{name}, {_NAMES[tissue]}"
            felt.plot(time, values / values.max(), _DASHES[tissue], color=colour, label=label)
    felt.set(ylabel="Share of the largest")
    for name, model in models.items():
        trace = presses[model.tissue]
        time, drive = elapsed(trace), middle_sed(trace)[:, None]
        at = np.geomspace(_FIRST_S, time[-1], 600)
        rates = rate_of(current_at(at, time, drive, model.neuron), model.neuron)[:, 0]
        fired.plot(at, rates, _DASHES[model.tissue], color=COLOURS[name], label=name)
    fired.set(ylabel="Firing rate (spikes/s)")
    for axes in (felt, fired):
        axes.axvline(-presses["none"]["time_s"][0], color=INK, lw=0.6, ls=":")
        axes.set(xlabel="Time since first touch (s)", xscale="log", xlim=(_FIRST_S, None))
        axes.set_ylim(0, None)
        axes.legend(fontsize=8)
    return figure


@styled
def slide_figure(models: Mapping[str, Model], scans: Mapping[str, Histories]) -> Figure:
    """Draw drive and rate of the middle afferent over the displacement."""
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    felt, fired = figure.subplots(2, 1, sharex=True)
    for tissue, trace in scans.items():
        slide = trace["displacement_mm"] > 0
        felt.plot(
            trace["displacement_mm"][slide],
            middle_sed(trace)[slide],
            _DASHES[tissue],
            color=INK,
            label=_NAMES[tissue],
        )
    felt.set(ylabel="SED (kPa)")
    for name, model in models.items():
        trace = scans[model.tissue]
        time, end = trace["time_s"], trace["displacement_mm"][-1]
        at_mm = np.arange(0.0, end, 0.05)
        slide = trace["displacement_mm"] > 0
        at = np.interp(at_mm, trace["displacement_mm"][slide], time[slide])
        window = _WINDOW_MM * time[-1] / end
        rate = model.fires(trace).rate(at, window)[:, central_receptor(trace["receptors_mm"])]
        fired.plot(at_mm, rate, _DASHES[model.tissue], color=COLOURS[name], label=name)
    fired.set(xlabel="Displacement (mm)", ylabel="Firing rate (spikes/s)")
    for axes in (felt, fired):
        axes.set_ylim(0, None)
        axes.legend(fontsize=8, ncols=4, loc="lower right", bbox_to_anchor=(1, 1))
    return figure


@styled
def speed_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw what the speed of the scan does, from the rows of its table."""
    shown = "normal, N", "largest SED, kPa", "spikes", "peak, spikes/s"
    figure = Figure(figsize=(9, 2.8), layout="constrained")
    for axes, what in zip(figure.subplots(1, len(shown)), shown, strict=True):
        for name, colour in COLOURS.items():
            mine = [row for row in rows if row["model"] == name]
            speeds = [row["speed, mm/s"] for row in mine]
            axes.plot(speeds, [row[what] for row in mine], "o-", color=colour, label=name, ms=4)
        axes.set(xlabel="Speed (mm/s)", xscale="log")
        axes.set_title(what, fontsize=9)
        axes.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
        axes.minorticks_off()
        axes.set_ylim(0, None)
    axes.legend(fontsize=7)
    return figure
