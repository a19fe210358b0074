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
# give about $1/\sqrt n$. The mechanics has no inertia, and counts from 1 mm of slide on, when all
# skin slips.
#
#     python demos/neurons/grating.py results/grating
#     python demos/neurons/grating.py results/quick --speeds 20 --distance 1.4 --force 0.05

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from matplotlib.figure import Figure

from tactile_fem.cli.entry import run
from tactile_fem.output.plots import BLUE, DISPLACEMENT, GREEN, PAPER, VERMILION, styled
from tactile_fem.runtime.files import write_figure, write_table
from tactile_fem.runtime.logs import set_up
from tactile_fem.scan import completed
from tactile_fem.scan.results import Results
from tactile_fem.study import Study
from tactile_fem.study.file import load_study

COLOURS = {"SA1": BLUE, "RA": VERMILION, "PC": GREEN}
SLIPS_MM = 1.0
_STEPS = 16  # of a period of the grating


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


# %%
def main(
    folder: Path,
    *,
    speeds: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (20.0, 40.0, 80.0),
    period: float = 1.0,
    force: float = 0.3,
    distance: float = 4.0,
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
    set_up()
    scans = {
        speed: completed(grating(speed, period, force, distance, set_), folder / f"{speed:g}_mm_s")
        for speed in speeds
    }
    rows = [row for speed, scan in scans.items() for row in locking(scan, speed, period)]
    for row in rows:
        print(
            f"{row.speed_mm_s:g} mm/s, {row.ridges_Hz:g} ridges/s, {row.kind}: "
            f"{row.rate_Hz:.0f} spikes/s, vector strength {row.vector_strength:.2f} "
            f"(chance {row.chance:.2f})"
        )
    write_table(folder / "locking.csv", rows)
    write_figure(folder / "grating.png", grating_figure(scans, period))
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
    """Return rates and vector strengths of each kind once the skin slips."""
    spikes, rows = scan.spikes, []
    slides_s = (scan.trace["displacement_mm"][-1] - SLIPS_MM) / speed
    for kind in COLOURS:
        counted = (spikes.population == kind) & (spikes.displacement_mm >= SLIPS_MM)
        at, who = spikes.displacement_mm[counted], spikes.receptor[counted]
        count = len(scan.receptors_of(kind))
        # Each afferent has its own phase: the ridges reach it at its own place and delay.
        sums = [np.exp(2j * np.pi * at[who == one] / period).sum() for one in np.unique(who)]
        total = max(len(at), 1)
        rows.append(
            Row(
                speed,
                speed / period,
                kind,
                count,
                len(at) / count / slides_s,
                float(np.abs(sums).sum() / total),
                float(np.sqrt(len(sums) / total)),
            )
        )
    return rows


@styled
def grating_figure(scans: dict[float, Results], period: float) -> Figure:
    """Draw the spikes of all afferents over the displacement, a panel for each speed."""
    figure = Figure(figsize=(7.2, 2.2 * len(scans)), layout="constrained")
    panels = figure.subplots(len(scans), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (speed, scan) in zip(panels, scans.items(), strict=True):
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
        ax.set_xlim(0, end)
        ax.set_yticks([])
        ax.set_ylabel(f"{speed:g} mm/s\n{speed / period:g} ridges/s")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=3, loc="outside upper right")
    panels[-1].set_xlabel(DISPLACEMENT)
    return figure


if __name__ == "__main__":
    run(main)
