"""What is written of a vibration, and its figure: amplitude, phase, firing rates over frequency."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem import Results
from tactile_fem.output import (
    BLUE,
    GREEN,
    INK,
    VERMILION,
    Modes,
    draw_pictures,
    styled,
)
from tactile_fem.results import central_receptor
from tactile_fem.runtime.files import write_figure
from tactile_fem.vibration.spectrum import Spectrum

_COLOURS = (BLUE, VERMILION, GREEN, INK)


def write_vibration(
    results: Results, spectrum: Spectrum, modes: Modes | None, amplitude_mm: float
) -> list[Path]:
    """Write data, tables and figures of a vibration into the folder of its scan; return them."""
    folder = results.vibration
    folder.mkdir(exist_ok=True)
    populations = [afferents.population() for afferents in results.study.populations]
    names = [population.name for population in populations]
    rates = spectrum.all_rates_Hz(populations, amplitude_mm)
    files = [folder / f"spectrum.{kind}" for kind in ("npz", "csv", "png")]
    spectrum.save(files[0])
    spectrum.write_table(files[1], rates, amplitude_mm)
    write_figure(files[2], spectrum_figure(spectrum, names, rates, amplitude_mm))
    if modes is not None:
        for earlier in folder.glob("shape_*_Hz.png"):
            earlier.unlink()
        files.append(folder / "modes.npz")
        modes.save(files[-1])
        if results.study.output.pictures:
            files += draw_pictures(results, amplitude_mm)
    return files


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
