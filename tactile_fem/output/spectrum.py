"""The figure of a vibration: amplitude and phase over frequency, and firing rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem.neuron import Population
from tactile_fem.output.plots import BLUE, GREEN, INK, VERMILION, styled
from tactile_fem.vibration.spectrum import Spectrum

_COLOURS = (BLUE, VERMILION, GREEN, INK)


@styled
def spectrum_figure(
    spectrum: Spectrum, populations: Sequence[Population], amplitude_mm: float
) -> Figure:
    """Draw force, strain energy density, displacement and firing rates over the frequency.

    Of each population the receptor closest to the contact point at rest (X = Y = 0) is drawn.

    Parameters
    ----------
    spectrum
        What was computed.
    populations
        The afferents.
    amplitude_mm
        Of the vibration.
    """
    figure = Figure(figsize=(7.2, 7.0), layout="constrained")
    force, sed, moved, rate = axes = figure.subplots(4, 1, sharex=True)
    f = spectrum.frequency_Hz
    along = spectrum.force_N @ spectrum.motion
    _bode(force, f, along, INK, "force", "Force along\nthe motion (N/mm)")
    for population, colour in zip(populations, _COLOURS * len(populations), strict=False):
        r = _middle(spectrum, population.name)
        name = population.name
        _bode(sed, f, spectrum.sed_kPa[:, r], colour, name, "SED (kPa/mm)")
        _bode(moved, f, spectrum.moved[:, r] @ spectrum.motion, colour, name, "Motion (mm/mm)")
        own = np.flatnonzero(spectrum.population == name).tolist().index(r)
        rates = [spectrum.rates_Hz(k, amplitude_mm, population)[own] for k in range(len(f))]
        rate.plot(f, rates, "o-", color=colour, markersize=3, label=name)
    rate.plot(f, f, ":", color=INK, linewidth=0.8, label="one spike a period")
    rate.set_ylim(0, max(50.0, 1.1 * max(line.get_ydata()[:-1].max() for line in rate.lines[:-1])))
    rate.set_ylabel(f"Spikes/s at {1000 * amplitude_mm:g} µm")
    rate.set_xlabel("Frequency (Hz)")
    for ax in axes:
        ax.set_xscale("log")
        ax.grid(alpha=0.2, which="both", linewidth=0.5)
    rate.legend(ncols=4, fontsize=7)
    sed.legend(ncols=4, fontsize=7)
    return figure


def _middle(spectrum: Spectrum, population: str) -> int:
    """Return the receptor of a population that is closest to X = Y = 0."""
    own = np.flatnonzero(spectrum.population == population)
    return int(own[np.linalg.norm(spectrum.receptors_mm[own, :2], axis=1).argmin()])


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
