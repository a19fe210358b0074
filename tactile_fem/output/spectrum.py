"""The figure of a vibration: amplitude and phase over frequency, and firing rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem.output.histories import central_receptor
from tactile_fem.output.plots import BLUE, GREEN, INK, VERMILION, styled
from tactile_fem.vibration.spectrum import Spectrum

_COLOURS = (BLUE, VERMILION, GREEN, INK)


@styled
def spectrum_figure(
    spectrum: Spectrum, names: Sequence[str], rates_Hz: np.ndarray, amplitude_mm: float
) -> Figure:
    """Draw force, strain energy density, displacement and firing rates over the frequency.

    Of each population the receptor closest to the contact point at rest (X = Y = 0) is drawn. The
    firing rates (f, r), see `Spectrum.rates_Hz`, are those at the amplitude of the vibration.
    """
    figure = Figure(figsize=(7.2, 7.0), layout="constrained")
    force, sed, moved, rate = axes = figure.subplots(4, 1, sharex=True)
    f = spectrum.frequency_Hz
    along = spectrum.force_N @ spectrum.motion
    _bode(force, f, along, INK, "force", "Force along\nthe motion (N/mm)")
    for name, colour in zip(names, _COLOURS * len(names), strict=False):
        own = np.flatnonzero(spectrum.population == name)
        r = own[central_receptor(spectrum.receptors_mm[own])]
        _bode(sed, f, spectrum.sed_kPa[:, r], colour, name, "SED (kPa/mm)")
        _bode(moved, f, spectrum.moved[:, r] @ spectrum.motion, colour, name, "Motion (mm/mm)")
        rate.plot(f, rates_Hz[:, r], "o-", color=colour, markersize=3, label=name)
    rate.plot(f, f, ":", color=INK, linewidth=0.8, label="one spike a period")
    highest = max(np.nanmax(line.get_ydata(), initial=0.0) for line in rate.lines[:-1])
    rate.set_ylim(0, max(50.0, 1.1 * highest))
    rate.set_ylabel(f"Spikes/s at {1000 * amplitude_mm:g} µm")
    rate.set_xlabel("Frequency (Hz)")
    for ax in axes:
        ax.set_xscale("log")
        ax.grid(alpha=0.2, which="both", linewidth=0.5)
    rate.legend(ncols=4, fontsize=7)
    sed.legend(ncols=4, fontsize=7)
    return figure


def _bode(ax: Axes, f: np.ndarray, values: np.ndarray, colour: str, label: str, what: str) -> None:
    """Draw the amplitude, and the phase in degrees as a dashed line at the right."""
    ax.loglog(f, np.abs(values), color=colour, label=label)
    ax.set_ylabel(what)
    if not hasattr(ax, "phase"):
        ax.phase = ax.twinx()
        ax.phase.set_ylabel("Phase (°)", fontsize=7)
        ax.phase.spines["right"].set_visible(True)
    phase = np.degrees(np.unwrap(np.angle(values)))
    ax.phase.semilogx(f, phase, "--", color=colour, linewidth=0.8)
