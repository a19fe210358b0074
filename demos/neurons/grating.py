# %% [markdown]
# # A grating stroked at several speeds
#
# This demo emphasizes
# - afferents that lock to the ridges they are stroked by, at the speed over the period, v/lambda,
# - SA1, RA and PC afferents in one scan, at several speeds.
#
# The vector strength tells how firmly spikes keep to one phase of the ridges passing by:
#
# $$ r = \left| \frac1n \sum_k e^{2 \pi i\, d(t_k) / \lambda} \right|, $$
#
# with the displacement $d$ at each spike; 1 is always the same phase, and 0 is none. Random spikes
# give about $1/\sqrt n$. It is also small if an afferent fires several times a ridge, at several
# phases. Therefore a second measure: the share of spikes that the same afferent repeats one period
# later, to 3 % of a period. The spectrum of what afferents feel tells whether the ridges reach them
# at all. The mechanics has no inertia, and counts from 1 mm of slide on, when all skin slips.
#
#     python demos/neurons/grating.py results/grating
#     python demos/neurons/grating.py results/fine --period 1 --distance 6
#     python demos/neurons/grating.py results/quick --speeds 20 --distance 1.4 --force 0.05

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from matplotlib.figure import Figure

from tactile_fem import Results, Study, completed, load_study, run_script, write_table
from tactile_fem.output.annotations import BLUE, GREEN, VERMILION
from tactile_fem.output.histories import DISPLACEMENT
from tactile_fem.output.plots import PAPER, styled

COLOURS = {"SA1": BLUE, "RA": VERMILION, "PC": GREEN}
SLIPS_MM = 1.0
_STEPS = 16  # of a period of the grating
_SAME = 0.03  # of a period: how far a repeated spike may be from where it should be


@dataclass(frozen=True)
class Row:
    """How a kind of afferent answers at one speed."""

    speed_mm_s: float
    ridges_Hz: float
    kind: str
    afferents: int
    rate_Hz: float
    vector_strength: float
    chance: float
    repeated: float
    repeated_by_chance: float
    drive_amplitude: float
    drive_peak_Hz: float


# %%
def main(
    folder: Path,
    *,
    speeds: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (20.0, 40.0, 80.0),
    period: float = 2.0,
    force: float = 0.3,
    distance: float = 9.0,
    set_: Annotated[tuple[str, ...], Parameter(name="--set", consume_multiple=True)] = (),
) -> None:
    """Stroke a grating at several speeds.

    Parameters
    ----------
    folder
        For the scans, the table and the figure.
    speeds
        In mm/s.
    period, force, distance
        Of the grating, mm; of the press, N, whose depth is held; of the slide, mm.
    set_
        Further values of the study, ``section.key=value``.
    """
    scans = {
        speed: completed(grating(speed, period, force, distance, set_), folder / f"{speed:g}_mm_s")
        for speed in speeds
    }
    rows = [row for speed, scan in scans.items() for row in locking(scan, speed, period)]
    for row in rows:
        print(
            f"{row.speed_mm_s:g} mm/s, {row.ridges_Hz:g} ridges/s, {row.kind}: "
            f"{row.rate_Hz:.0f} spikes/s, vector strength {row.vector_strength:.2f} "
            f"(chance {row.chance:.2f}), {100 * row.repeated:.0f} % repeated "
            f"(chance {100 * row.repeated_by_chance:.0f} %); felt amplitude "
            f"{row.drive_amplitude:.3g}, spectral peak {row.drive_peak_Hz:.0f} Hz"
        )
    write_table(folder / "locking.csv", rows)
    grating_figure(scans, period).savefig(folder / "grating.png")
    print(folder / "grating.png")


def grating(
    speed: float, period: float, force: float, distance: float, settings: tuple[str, ...]
) -> Study:
    """Return the study of one speed."""
    study = load_study(
        overrides=[
            "finger.preset=coarse",
            "stimulus.kind=grating",
            f"stimulus.ridge_mm={period / 2}",
            f"stimulus.groove_mm={period / 2}",
            f"stimulus.relief_mm={0.3 * period}",
            f"stimulus.fillet_radius_mm={0.1 * period}",
            "stimulus.count=51",
            f"protocol.force_N={force}",
            f"protocol.speed_mm_s={speed}",
            f"protocol.distance_mm={distance}",
            f"protocol.output_mm={period / _STEPS}",
            "receptors.half_width_mm=2.0",
            "receptors.spacing_mm=0.25",
            "output.pictures=false",
            *settings,
        ]
    )
    kinds = [{"name": kind, "kind": kind} for kind in COLOURS]
    return Study.model_validate({**study.model_dump(), "afferents": kinds})


def locking(scan: Results, speed: float, period: float) -> list[Row]:
    """Return rates, vector strengths and what is felt of each kind once the skin slips."""
    spikes, rows = scan.spikes, []
    slides_s = (scan.trace["displacement_mm"][-1] - SLIPS_MM) / speed
    for kind in COLOURS:
        counted = (spikes.population == kind) & (spikes.displacement_mm >= SLIPS_MM)
        at, who = spikes.displacement_mm[counted], spikes.receptor[counted]
        count = len(scan.receptors_of(kind))
        # Each afferent has its own phase: the ridges reach it at its own place and delay.
        each = [at[who == one] for one in np.unique(who)]
        total = max(len(at), 1)
        strength = sum(abs(np.exp(2j * np.pi * own / period).sum()) for own in each) / total
        times, amplitudes = spectrum(scan, kind, period)
        rows.append(
            Row(
                speed,
                speed / period,
                kind,
                count,
                len(at) / count / slides_s,
                float(strength),
                float(np.sqrt(len(each) / total)),
                *repetition(each, period, scan.trace["displacement_mm"][-1]),
                float(np.interp(1.0, times, amplitudes)),
                float(times[amplitudes.argmax()] * speed / period),
            )
        )
    return rows


def repetition(each_mm: list[np.ndarray], period: float, end_mm: float) -> tuple[float, float]:
    """Return the share of spikes that are repeated one period later, and that by chance.

    By chance are those of random spikes at the same rates; `each_mm` are those of the afferents.
    """
    repeated, by_chance, count = 0.0, 0.0, 0
    for at in each_mm:
        late = np.abs(at[:, None] + period - at).min(axis=1)
        asked = at + (1 + _SAME) * period <= end_mm
        in_period = len(at) * period / (end_mm - SLIPS_MM)
        repeated += np.sum(late[asked] <= _SAME * period)
        by_chance += asked.sum() * -np.expm1(-2 * _SAME * in_period)
        count += asked.sum()
    return float(repeated / max(count, 1)), float(by_chance / max(count, 1))


def spectrum(scan: Results, kind: str, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies as multiples of the ridges', and mean amplitudes of what a kind feels.

    Over the last whole number of periods once the skin slips; a parabola is taken away.
    """
    populations = {each.name: each.population() for each in scan.study.populations}
    _, felt = populations[kind].drive.of(scan.trace)
    along = scan.trace["displacement_mm"]
    length = max(int((along[-1] - SLIPS_MM) / period), 1) * period
    rows = along >= max(along[-1] - length, 0.0) - 1e-9
    even = np.linspace(along[rows][0], along[-1], 401)
    felt = felt[rows][:, scan.receptors_of(kind)]
    values = np.stack([np.interp(even, along[rows], one) for one in felt.T], axis=1)
    trend = np.polynomial.polynomial.polyvander(even - even.mean(), 2)
    values -= trend @ np.linalg.lstsq(trend, values)[0]
    window = np.hanning(len(even))
    times = np.linspace(0.5, 3.5, 121)
    waves = np.exp(-2j * np.pi * np.outer(times, even) / period) * window / window.sum()
    return times, 2 * np.abs(waves @ values).mean(axis=1)


@styled
def grating_figure(scans: dict[float, Results], period: float) -> Figure:
    """Draw spikes over the displacement and the spectra of what is felt, a row for each speed."""
    figure = Figure(figsize=(7.2, 2.2 * len(scans)), layout="constrained")
    shares = {"sharex": "col", "squeeze": False, "width_ratios": (3, 1)}
    panels = figure.subplots(len(scans), 2, **shares)
    for (ax, right), (speed, scan) in zip(panels, scans.items(), strict=True):
        spikes, end = scan.spikes, scan.trace["displacement_mm"][-1]
        for k in range(int(end / period) + 1):
            ax.axvspan((k - 0.25) * period, (k + 0.25) * period, color=PAPER, zorder=0)
        for kind, colour in COLOURS.items():
            own = (spikes.population == kind) & (spikes.displacement_mm > 0)
            ax.plot(
                spikes.displacement_mm[own],
                spikes.receptor[own],
                ls="none",
                marker="|",
                ms=3,
                color=colour,
                label=kind,
            )
            times, amplitudes = spectrum(scan, kind, period)
            right.plot(times, amplitudes / amplitudes.max(), color=colour)
        right.set_yticks([])
        ax.set_xlim(0, end)
        ax.set_yticks([])
        ax.set_ylabel(f"{speed:g} mm/s\n{speed / period:g} ridges/s")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=3, loc="outside upper right")
    panels[-1, 0].set_xlabel(DISPLACEMENT)
    panels[-1, 1].set_xlabel("Frequency over v/λ")
    panels[0, 1].set_title("What they feel")
    return figure


if __name__ == "__main__":
    run_script(main)
