# %% [markdown]
# # A solid finger and a section of it, side by side
#
# This demo emphasizes
# - what plane strain gets right and wrong: the history of strain energy density (SED) of the middle
#   receptor, the places of its maxima and how large they are beside each other,
# - a section as a quick stand-in for a solid finger.
#
# The section is the plane X = 0 of the same finger, and its stimulator the same body cut by this
# plane. The solid finger is pressed to a force, the section to that force over a width: the force
# is what a section can share with a finger, not the depth. Two stimulators: bars across the whole
# finger, of which plane strain should know most, and a letter.
#
#     python demos/sections/beside_solid.py results/beside --jobs 2
#     python demos/sections/beside_solid.py results/quick --distance 0.4 --force 0.05 --stimuli bars

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem import Results, Study, StudyError, run_script, write_table
from tactile_fem.output.annotations import BLUE, VERMILION
from tactile_fem.output.histories import DISPLACEMENT, central_receptor, extrema
from tactile_fem.series import Member, complete_scans, run_series

Array = NDArray[np.float64]

BARS = {"kind": "grating", "count": 3, "ridge_mm": 1.5, "groove_mm": 2.5}
STIMULI = {"bars": BARS, "letter": {"text": "G"}}
KINDS = "solid", "section"
# A maximum of one finger belongs to one of the other not farther away.
_SAME_MM = 1.5


@dataclass(frozen=True)
class Maximum:
    """A maximum of the middle receptor's SED in the solid finger, and the section's nearest."""

    stimulus: str
    solid_mm: float
    section_mm: float
    solid_kPa: float
    section_kPa: float
    solid_share: float
    section_share: float


# %%
def main(
    folder: Path,
    *,
    stimuli: Annotated[tuple[str, ...], Parameter(consume_multiple=True)] = tuple(STIMULI),
    force: float = 0.6,
    width: float = 10.0,
    distance: float = 10.0,
    preset: str = "coarse",
    jobs: int = 1,
) -> None:
    """Scan stimulators with a solid finger and with a section of it.

    Parameters
    ----------
    stimuli
        "bars" and "letter".
    force, width
        Of the press, N; mm over which it is spread in the section.
    distance
        Slide, mm.
    jobs
        Scans at a time.
    """
    if unknown := set(stimuli) - STIMULI.keys():
        raise StudyError(f"stimuli = {sorted(unknown)}: known are {', '.join(STIMULI)}")
    members = []
    for name in stimuli:
        for kind in KINDS:
            pressed = force if kind == "solid" else force / width
            own = study(name, kind, pressed, distance, preset)
            members.append(Member(f"{name}_{kind}", own, {"stimulus": name, "finger": kind}))
    run_series(members, folder, jobs=jobs)
    scans = complete_scans(members, folder)
    if len(scans) < len(members):
        return
    pairs = {name: scans[2 * k : 2 * k + 2] for k, name in enumerate(stimuli)}
    maxima = [row for name, pair in pairs.items() for row in compare(name, *pair)]
    if maxima:
        write_table(folder / "beside_solid.csv", maxima)
    draw(pairs).savefig(folder / "beside_solid.png", dpi=160)
    print(folder / "beside_solid.png")


def study(stimulus: str, kind: str, force: float, distance_mm: float, preset: str) -> Study:
    """Return the study of a finger of a kind, pressed to a force, N or N/mm."""
    return Study.model_validate(
        {
            "finger": {"kind": kind, "preset": preset},
            "stimulus": STIMULI[stimulus],
            "protocol": {"force_N": force, "press_speed_mm_s": 5.0, "distance_mm": distance_mm},
            "output": {"pictures": False},
        }
    )


# %%
def compare(name: str, solid: Results, section: Results) -> list[Maximum]:
    """Print how the two histories differ; return their maxima."""
    (at, one), (own, other) = history(solid), history(section)
    same = np.interp(at, own, other)
    r = np.corrcoef(one, same)[0, 1] if np.ptp(one) and np.ptp(same) else np.nan
    cost = [float(results.trace["wall_s"].sum()) for results in (solid, section)]
    depth = [float(results.trace["depth_mm"].max()) for results in (solid, section)]
    print(
        f"{name}: {depth[0]:.2f} mm deep, section {depth[1]:.2f}; largest SED {one.max():.3f} kPa, "
        f"section {other.max():.3f} ({other.max() / one.max():.2f} times); mean {one.mean():.3f}, "
        f"{other.mean():.3f}; r = {r:.3f}; {cost[0]:.0f} s, section {cost[1]:.0f} s"
    )
    highs, theirs = extrema(one)[0], extrema(other)[0]
    rows = []
    for k in highs:
        near = theirs[np.abs(own[theirs] - at[k]) < _SAME_MM]
        if not len(near):
            print(f"  {at[k]:5.2f} mm, {one[k]:.3f} kPa: no maximum of the section")
            continue
        match = near[np.argmin(np.abs(own[near] - at[k]))]
        shares = one[k] / one.max(), other[match] / other.max()
        rows.append(Maximum(name, at[k], own[match], one[k], other[match], *shares))
        print(
            f"  {at[k]:5.2f} mm, section {own[match] - at[k]:+.2f} mm; {one[k]:.3f} kPa, "
            f"{other[match]:.3f}; of the largest {shares[0]:.2f}, {shares[1]:.2f}"
        )
    print(f"  maxima: {len(highs)}, section {len(theirs)}")
    return rows


def history(results: Results) -> tuple[Array, Array]:
    """Return displacement (n,) in mm and SED (n,) in kPa of the middle receptor in the slide."""
    trace = results.trace
    slide = trace["displacement_mm"] > 0
    centre = central_receptor(trace["receptors_mm"])
    return trace["displacement_mm"][slide], trace["sed_kPa"][slide, centre]


# %%
def draw(pairs: dict[str, list[Results]]) -> Figure:
    """Draw both histories of each stimulator, in kPa and as a share of the largest."""
    figure = Figure(figsize=(8.5, 2.6 * len(pairs)), layout="constrained")
    for (name, pair), (left, right) in zip(
        pairs.items(), figure.subplots(len(pairs), 2, sharex=True, squeeze=False), strict=True
    ):
        for results, kind, color in zip(pair, KINDS, (BLUE, VERMILION), strict=True):
            at, sed = history(results)
            left.plot(at, sed, color=color, label=kind)
            right.plot(at, sed / sed.max(), color=color, label=kind)
        left.set_ylabel(f"{name}: SED (kPa)")
        right.set_ylabel("SED / its largest")
        for axes in (left, right):
            axes.set_ylim(bottom=0)
            axes.spines[["top", "right"]].set_visible(False)
        left.legend(frameon=False)
    for axes in (left, right):
        axes.set_xlabel(DISPLACEMENT)
    return figure


if __name__ == "__main__":
    run_script(main)
