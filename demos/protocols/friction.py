# %% [markdown]
# # Effects of friction on a letter
#
# This demo emphasizes
# - strain energy density, spikes and legibility as friction grows from 0 to 1,
# - a sweep over a value of the study.
#
# With friction $\mu$ the slide stretches and compresses the skin: $|s_t| \le \mu s_n$. The
# correlation of the firing image with the letter's outline, at the best shift, measures how much of
# the letter is represented.
#
#     python demos/protocols/friction.py results/friction --jobs 2
#     python demos/protocols/friction.py results/quick --values 0 0.5 --depth 0.6 --distance 0.6

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from firing_images import population_image
from letter_recognition import outline_correlation
from matplotlib.figure import Figure

from tactile_fem import Results, run_script, write_table
from tactile_fem.output.annotations import BLUE, GREEN, INK, VERMILION
from tactile_fem.output.histories import DISPLACEMENT, central_receptor
from tactile_fem.series import (
    complete_scans,
    numbers_of,
    run_series,
    sweep,
    write_summary,
)

_FRICTIONS = (0.0, 0.1, 0.3, 0.6, 1.0)


@dataclass(frozen=True)
class Row:
    """Results for one friction coefficient."""

    friction: float
    normal_N: float
    tangential_N: float
    largest_sed_kPa: float
    central_sed_kPa: float
    spikes: int
    outline_correlation: float


# %%
def main(
    folder: Path,
    *,
    values: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = _FRICTIONS,
    text: str = "G",
    depth: float = 1.97,
    distance: float = 10.0,
    output: float = 0.1,
    preset: str = "coarse",
    jobs: int = 1,
) -> None:
    """Scan a letter with each friction and compare what is felt.

    Parameters
    ----------
    output
        Positions of the slide that are hit exactly, mm; steps are no longer than that.
    jobs
        Scans at a time.
    """
    overrides = [
        f"finger.preset={preset}",
        f"stimulus.text={text}",
        f"protocol.depth_mm={depth}",
        f"protocol.distance_mm={distance}",
        f"protocol.output_mm={output}",
    ]
    axis = f"stimulus.friction={','.join(map(str, values))}"
    members = sweep([axis], overrides=overrides)
    run_series(members, folder, jobs=jobs)
    print(write_summary(members, folder))
    scans = complete_scans(members, folder)
    rows = [row(results) for results in scans]
    for r in rows:
        print(
            f"friction {r.friction:.2f}: {r.normal_N:.4f} N, {r.tangential_N:.4f} N across; "
            f"SED at most {r.largest_sed_kPa:.2f} kPa, in the middle {r.central_sed_kPa:.2f}; "
            f"{r.spikes} spikes, outline r = {r.outline_correlation:.3f}"
        )
    write_table(folder / "friction.csv", rows)
    draw(scans, rows).savefig(folder / "friction.png", dpi=200)
    print(folder / "friction.png")


def row(results: Results) -> Row:
    """Return the numbers of one scan's slide."""
    stimulus, numbers = results.study.stimulus, numbers_of(results)
    image = population_image(results)
    return Row(
        stimulus.friction,
        numbers["normal_N"],
        numbers["tangential_N"],
        numbers["largest_sed_kPa"],
        numbers["central_largest_sed_kPa"],
        int(image.response.counts().sum()),
        outline_correlation(image, stimulus),
    )


def draw(scans: list[Results], rows: list[Row]) -> Figure:
    """Draw the histories of the middle receptor, and the numbers over friction."""
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    shades = np.linspace(0.75, 0.0, len(scans))
    for results, shade in zip(scans, shades, strict=True):
        trace = results.trace
        slide = trace["displacement_mm"] >= 0
        central = central_receptor(trace["receptors_mm"])
        left.plot(
            trace["displacement_mm"][slide],
            trace["sed_kPa"][slide, central],
            color=(shade, shade, shade),
            label=f"$\\mu$ = {results.study.stimulus.friction:g}",
        )
    left.set(xlabel=DISPLACEMENT, ylabel="SED of the middle receptor (kPa)", ylim=(0, None))
    left.legend(frameon=False, fontsize=8)
    friction = [r.friction for r in rows]
    curves = {
        "largest SED": ([r.largest_sed_kPa for r in rows], BLUE, "o"),
        "spikes": ([r.spikes for r in rows], VERMILION, "s"),
        "correlation with the outline": ([r.outline_correlation for r in rows], GREEN, "^"),
    }
    for label, (values, colour, marker) in curves.items():
        share = np.array(values) / max(np.abs(values).max(), 1e-12)
        right.plot(friction, share, color=colour, marker=marker, label=label)
    right.set(xlabel="Friction coefficient", ylabel="Share of the largest", ylim=(0, 1.08))
    right.legend(frameon=False, fontsize=8)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(colors=INK)
    return figure


if __name__ == "__main__":
    run_script(main)
