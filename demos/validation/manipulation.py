# %% [markdown]
# # Afferents of a fingertip that a plate pushes as an object does in manipulation
#
# Saal, Birznieks and Johansson (eLife 89616) pushed a flat plate against human fingertips without
# slip: from 0.2 N to 4 N and back, straight or with 1.4 N along the skin, in two orders, and
# recorded 60 FA-1, 73 SA-1 and 41 SA-2 afferents. As many lie at random on pad, sides and end of
# the model. What they feel comes from `manipulation_histories.py`, and how they fire is in
# `manipulation_firing.py`. Nothing is fitted to these recordings.
#
#     python demos/validation/manipulation.py results/manipulation
#
# - the way of the plate, and how it depends on the load before,
# - rates over time,
# - preferred directions, by place and kind,
# - how many afferents respond otherwise because of the load before.

# %%
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from manipulation_firing import (
    COUNTED_S,
    COUNTS,
    LOAD_S,
    LOADS,
    ORDERS,
    PAUSE_S,
    TANGENTIAL,
    Array,
    Kept,
    Responses,
    at_rest,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem import run_script, write_table

AT_REST = "20 of 41"  # SA-2 that fired without a load
# Bias of preferred directions: Birznieks et al. 2001, J Neurosci 21:8222.
BIASED = {"RA": "proximal and radial", "SA1": "distal", "SA2": "proximal"}
COLOURS = {"RA": "#D55E00", "SA1": "#0072B2", "SA2": "#009E73"}
OF_LOAD = dict(zip(LOADS, ("#222222", "#0072B2", "#D55E00", "#009E73", "#CC79A7"), strict=True))
STYLES = dict(zip(ORDERS, ("-", "--"), strict=True))
WINDOW_S = 0.02


# %%
def main(folder: Path, *, histories: Path | None = None) -> None:
    """Fire, compare and draw.

    Parameters
    ----------
    folder
        Folder for tables and figures.
    histories
        Folder of `manipulation_histories.py`; by default the same.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept = [Kept.of(histories or folder, order) for order in ORDERS]
    found = Responses.of(kept)
    write_table(folder / "afferents.csv", list(rows_of(found)))
    print_way(kept)
    print_afferents(found)
    draw_way(folder / "way.png", kept)
    draw_rates(folder / "rates.png", kept)
    draw_directions(folder / "directions.png", found)
    draw_pairs(folder / "pairs.png", found)


def rows_of(found: Responses) -> list[dict[str, Any]]:
    """Return place, tuning and spikes of each afferent."""
    arrays = found.kept[0].arrays
    return [
        {
            "kind": str(kind),
            **dict(zip(("x_mm", "y_mm", "z_mm"), arrays["receptors_mm"][r].round(3), strict=True)),
            **dict(zip(("towards_x", "towards_y"), found.tuning[r].round(3), strict=True)),
            **{
                f"{load}_{one.order}": int(found.spikes[load][k, r])
                for load in LOADS
                for k, one in enumerate(found.kept)
            },
        }
        for r, kind in enumerate(arrays["population"])
    ]


def print_way(kept: Sequence[Kept]) -> None:
    """Print how far the plate moves along the skin, aside of the force, and by the load before."""
    print(
        "| load | X, Y of the plate, mm, each order | deviation, degrees | by the load before, mm |"
    )
    print("| --- | --- | --- | --- |")
    for load, force in LOADS.items():
        starts = [one.start_s(load) for one in kept]
        pairs = list(zip(kept, starts, strict=True))
        before = [one.at("stimulator_mm", start)[:2] for one, start in pairs]
        ends = [one.at("stimulator_mm", start + COUNTED_S)[:2] for one, start in pairs]
        moves = [end - start for end, start in zip(ends, before, strict=True)]
        ways = "; ".join(f"{x:.2f}, {y:.2f}" for x, y in moves)
        aside = "; ".join(f"{angle(move, np.array(force)):.1f}" for move in moves)
        apart = np.linalg.norm(ends[0] - ends[1])
        print(f"| {load} | {ways} | {aside if any(force) else ''} | {apart:.3f} |")


def angle(one: Array, other: Array) -> float:
    """Return the angle between two vectors, degrees."""
    cross = one[0] * other[1] - one[1] * other[0]
    return float(np.degrees(np.arctan2(abs(cross), one @ other)))


def print_afferents(found: Responses) -> None:
    """Print what is known of people's afferents beside the model's."""
    directions = " | ".join(TANGENTIAL)
    print(f"\n| kind | respond | {directions} | biased in people | other responses | afferents |")
    print("| --- " * (5 + len(TANGENTIAL)) + "|")
    for kind in COUNTS:
        own = found.own(kind)
        respond = f"{(found.responding & own).sum()} of {own.sum()}"
        shares = " | ".join(f"{100 * found.share_towards(kind, each):.0f} %" for each in TANGENTIAL)
        changed = " | ".join(f"{100 * share:.0f} %" for share in found.otherwise(kind))
        print(f"| {kind} | {respond} | {shares} | {BIASED[kind]} | {changed} |")
    firing = at_rest(found.kept[0].arrays["population"])[found.own("SA2")] > 0
    print(f"\nSA2 that fire without a load: {firing.sum()} of {firing.size}; in people {AT_REST}")
    for one in found.kept:
        rates = "; ".join(
            f"{load} {one.pause_Hz(number)[found.own('SA2')].mean():.1f}"
            for number, load in enumerate(one.loads)
        )
        print(f"SA2 in the pause after each load, spikes/s, order {one.order}: {rates}")


# %%
def draw_way(picture: Path, kept: Sequence[Kept]) -> None:
    """Draw the way of the plate along the skin, and its force over way and depth."""
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    skin, along, depth = figure.subplots(1, 3)
    for one in kept:
        for load in LOADS:
            start = one.start_s(load)
            whole = start, start + LOAD_S - PAUSE_S
            x, y, z = one.within("stimulator_mm", *whole).T
            force = one.within("force_N", *whole)
            label = load if one is kept[0] else ""
            style: dict[str, Any] = {"color": OF_LOAD[load], "ls": STYLES[one.order], "lw": 1.2}
            skin.plot(x, y, label=label, **style)
            depth.plot(z, force[:, 2], **style)
            if any(LOADS[load]):
                unit = np.sign(LOADS[load])
                along.plot(unit @ [x - x[0], y - y[0]], force[:, :2] @ unit, **style)
    for order, style_of in STYLES.items():
        skin.plot([], [], color="#9A9A9A", ls=style_of, label=f"order {order}")
    skin.set(xlabel="X of the plate (mm), radial", ylabel="Y of the plate (mm), distal")
    skin.set_aspect("equal", "datalim")
    along.set(xlabel="Way along the force (mm)", ylabel="Force along the skin (N)")
    depth.set(xlabel="Depth of the plate (mm)", ylabel="Normal force (N)")
    figure.legend(*skin.get_legend_handles_labels(), loc="outside right center", frameon=False)
    finish(picture, figure, [skin, along, depth])


def draw_rates(picture: Path, kept: Sequence[Kept]) -> None:
    """Draw mean rates of each kind over time, below the force."""
    figure = Figure(figsize=(12, 7), layout="constrained")
    grid = figure.subplots(1 + len(COUNTS), len(kept), sharex=True, sharey="row")
    for one, (top, *below) in zip(kept, grid.T, strict=True):
        time = one.arrays["time_s"]
        for name, part in zip(
            ("along X", "along Y", "normal"), one.arrays["force_N"].T, strict=True
        ):
            top.plot(time, part, label=name, lw=1.0)
        for k, load in enumerate(one.loads):
            at = {"transform": top.get_xaxis_transform(), "ha": "center", "fontsize": 8}
            top.text((k + 0.33) * LOAD_S, 1.02, load, **at)
            for axes in (top, *below):
                axes.axvspan(k * LOAD_S, k * LOAD_S + COUNTED_S, color="#EEF2F6", zorder=0)
        fine = np.arange(time[0], time[-1], 5e-3)
        rates = one.noisy.rate(fine, WINDOW_S)
        for axes, kind in zip(below, COUNTS, strict=True):
            own = rates[:, one.arrays["population"] == kind]
            axes.plot(fine, own.mean(axis=1), color=COLOURS[kind], lw=1.2)
            axes.set_ylabel(f"{kind} (spikes/s)" if one is kept[0] else "")
        top.set_title(f"Order {one.order}", fontsize=10, pad=18)
        below[-1].set(xlabel="Time (s)", xlim=(-0.1, time[-1]))
    grid[0, 0].set_ylabel("Force (N)")
    lines = grid[0, 0].get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    finish(picture, figure, grid.ravel())


def draw_directions(picture: Path, found: Responses) -> None:
    """Draw the preferred direction of each afferent at its place, seen from below."""
    figure = Figure(figsize=(12, 5.4), layout="constrained")
    panels = figure.subplots(1, len(COUNTS), sharex=True, sharey=True)
    places = found.kept[0].arrays["receptors_mm"]
    for axes, kind in zip(panels, COUNTS, strict=True):
        own = found.own(kind)
        x, y, _ = places[own].T
        axes.plot(x, y, "o", ms=3, mfc="white", color="#9A9A9A")
        tuned = own & (np.linalg.norm(found.tuning, axis=1) > 0)
        (x, y), (u, v) = places[tuned, :2].T, found.tuning[tuned].T
        how = {"angles": "xy", "scale_units": "xy", "scale": 0.25, "width": 0.006}
        axes.quiver(x, y, u, v, color=COLOURS[kind], zorder=3, **how)
        shares = ", ".join(
            f"{load} {100 * found.share_towards(kind, load):.0f} %" for load in TANGENTIAL
        )
        axes.set_title(f"{kind}\n{shares}\nin people: {BIASED[kind]}", fontsize=9)
        axes.set(xlabel="X (mm), radial", aspect="equal", xlim=(-11, 11), ylim=(-17, 15))
    panels[0].set_ylabel("Y (mm), distal")
    finish(picture, figure, panels)


def draw_pairs(picture: Path, found: Responses) -> None:
    """Draw the spikes of each afferent under each load, in one order over the other."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    panels = figure.subplots(1, len(COUNTS))
    for axes, kind in zip(panels, COUNTS, strict=True):
        own = found.own(kind)
        most = max(int(counts[:, own].max(initial=0)) for counts in found.spikes.values()) + 1
        axes.plot([0, most], [0, most], color="#9A9A9A", lw=0.8)
        for load, counts in found.spikes.items():
            axes.plot(*counts[:, own], "o", ms=3.5, alpha=0.6, color=OF_LOAD[load], label=load)
        responses, of_all = (100 * share for share in found.otherwise(kind))
        axes.set_title(
            f"{kind}: {responses:.0f} % of responses, {of_all:.0f} % of afferents", fontsize=9
        )
        axes.set(xlabel="Spikes under a load, order one", aspect="equal")
    panels[0].set_ylabel("Spikes, order two")
    panels[0].legend(frameon=False, fontsize=8)
    finish(picture, figure, panels)


def finish(picture: Path, figure: Figure, panels: Sequence[Axes]) -> None:
    """Write a figure."""
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, dpi=120)


# %%
if __name__ == "__main__":
    run_script(main)
