# %% [markdown]
# # Firing on gratings and dots that slide under the finger, beside recorded rates
#
# Recorded (`measured/rates/textures.csv`): mean rates of 39 afferents of monkeys on a drum with
# gratings of period 12, 8, 5, 3 mm and dots on square lattices of 6, 4, 3, 2 mm. Heights, forces,
# widths and speed are not known to us. So the model slides them at several heights and forces, at
# 40, 80 and 120 mm/s, and the question is which orders and ratios hold anywhere in this range, and
# which nowhere; then, whether SA1 afferents that respond to something else than strain energy
# density would tell a grating of 3 mm from dots 2 mm apart as recorded ones do. Nothing is fitted
# to the recorded rates.
#
# What is felt comes from `texture_histories.py`, so that firing alone takes minutes.
#
#     python demos/validation/textures.py results/textures
#     python demos/validation/textures.py results/textures --histories results/histories --speeds 80

# %%
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from texture_firing import (
    HISTORIES,
    KINDS,
    SURFACES,
    Array,
    Felt,
    Kept,
    drives,
    mean_rates,
    recorded,
)

from tactile_fem import run_script, write_table

NAMES = tuple(SURFACES)
GRATINGS, DOTS = slice(0, 4), slice(4, 8)
BLUE, ORANGE, INK, GREY = "#0072B2", "#D55E00", "#222222", "#9A9A9A"
LEVEL = 1.3  # the largest rate over the smallest, if rates are level; recorded: 1.2
FACTOR = 2.0  # within which a ratio agrees
FINE, COARSE = "solid_medium_0.5mm_0.3N", "solid_coarse_0.5mm_0.3N"
DRIVES_MM_S = 80.0
SHARPEST = "difference of stretch", "linear"

# Rates, spikes/s, (speeds, files, surfaces), by kind.
RatesOf = dict[str, Array]


@dataclass(frozen=True)
class Rate:
    """Mean rate of a kind on a surface."""

    histories: str
    kind: str
    speed_mm_s: float
    surface: str
    recorded_Hz: float
    model_Hz: float


@dataclass(frozen=True)
class Driven:
    """Rates of SA1 afferents that respond to a drive, by a law that is fitted to bar and spheres.

    Attributes
    ----------
    drive, law
        What they respond to; compressed or linear.
    r2_bar, r2_spheres
        Share of the variance that the law explains there.
    histories
        Name of the file.
    rates
        Spikes/s, (8,), nan for what is not kept.
    ratio_of_drive
        Mean drive on dots 2 mm apart over that on a grating of 3 mm.
    """

    drive: str
    law: str
    r2_bar: float
    r2_spheres: float
    histories: str
    rates: Array
    ratio_of_drive: float

    @property
    def ratio(self) -> float:
        """Rate on dots 2 mm apart over that on a grating of 3 mm."""
        return ratio("dots_2", "grating_3")(self.rates, self.rates)

    @property
    def r(self) -> float:
        """Correlation with the recorded rates; nan where a surface is not kept."""
        return float(np.corrcoef(self.rates, recorded()["SA1"])[0, 1])

    def row(self) -> dict[str, str | float]:
        """Return what a table says of it."""
        rates = {f"{name}_Hz": rate for name, rate in zip(NAMES, self.rates, strict=True)}
        known = {key: value for key, value in vars(self).items() if key != "rates"}
        return known | {"ratio": self.ratio, "r": self.r} | rates


# %% [markdown]
# Claims are numbers made of the rates of SA1, RA and PC on the eight surfaces. An order holds if
# the number is above 1, a ratio if it is within a factor of two of the recorded one, and rates are
# level if the largest is at most 1.3 times the smallest.


# %%
@dataclass(frozen=True)
class Claim:
    """A number made of the rates of a kind and of SA1, (8,) each, and what makes it agree."""

    text: str
    kind: str
    of: Callable[[Array, Array], float]
    agrees: str  # order, ratio or level

    def holds(self, value: float, target: float) -> bool:
        """Return whether the model's number agrees with the recorded one."""
        match self.agrees:
            case "order":
                return value > 1
            case "level":
                return value <= LEVEL
        return target / FACTOR <= value <= target * FACTOR


def falling(rates: Array, _: Array) -> float:
    """Return the least ratio of a rate to the next."""
    return float((rates[:-1] / floored(rates[1:])).min())


def floored(rates: Array) -> Array:
    """Return rates to divide by; less than 1 spike/s counts as 1."""
    return np.maximum(rates, 1.0)


def most_at(*surfaces: str) -> Callable[[Array, Array], float]:
    """Return the function that divides the largest rate on some surfaces by that on others."""
    some = np.isin(NAMES, surfaces)
    return lambda rates, _: float(rates[some].max() / floored(rates[~some]).max())


def ratio(one: str, other: str) -> Callable[[Array, Array], float]:
    """Return the function that divides the rates on two surfaces."""
    i, j = NAMES.index(one), NAMES.index(other)
    return lambda rates, _: float(rates[i] / floored(rates)[j])


def spread(part: slice) -> Callable[[Array, Array], float]:
    """Return the function that divides the largest rate on some surfaces by the smallest."""
    return lambda rates, _: float(rates[part].max() / floored(rates[part]).min())


CLAIMS = (
    Claim("SA1: 3 mm dots over all others", "SA1", most_at("dots_3"), "order"),
    Claim(
        "SA1: gratings fall with the period, least step",
        "SA1",
        lambda rates, _: falling(rates[GRATINGS], _),
        "order",
    ),
    Claim("SA1: grating of 12 over 3 mm", "SA1", ratio("grating_12", "grating_3"), "ratio"),
    Claim("SA1: 2 mm dots over 3 mm grating", "SA1", ratio("dots_2", "grating_3"), "ratio"),
    Claim("SA1: 3 mm dots over 3 mm grating", "SA1", ratio("dots_3", "grating_3"), "ratio"),
    Claim("SA1: 3 over 6 mm dots", "SA1", ratio("dots_3", "dots_6"), "order"),
    Claim(
        "RA over SA1, least", "RA", lambda rates, sa1: float((rates / floored(sa1)).min()), "ratio"
    ),
    Claim(
        "RA over SA1, most", "RA", lambda rates, sa1: float((rates / floored(sa1)).max()), "ratio"
    ),
    Claim("RA: 2 and 3 mm dots over all others", "RA", most_at("dots_2", "dots_3"), "order"),
    Claim("PC: gratings, most over least", "PC", spread(GRATINGS), "level"),
    Claim("PC: dots from 3 mm on, most over least", "PC", spread(slice(4, 7)), "level"),
)


# %%
def main(
    folder: Path,
    *,
    histories: Path = HISTORIES,
    speeds: tuple[float, ...] = (40.0, 80.0, 120.0),
    only: tuple[str, ...] = (),
) -> None:
    """Fire, compare and draw.

    Parameters
    ----------
    folder
        Folder for tables and figure.
    histories
        Folder of `texture_histories.py`.
    speeds
        Speeds in mm/s.
    only
        Drives of SA1 that are compared, all unless named.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept = [Kept.of(path) for path in sorted(histories.glob("*.npz"))]
    solid = [one for one in kept if one.serves("SA1")]
    rates = {kind: np.array([mean_rates(kept, kind, speed) for speed in speeds]) for kind in KINDS}
    write_table(folder / "rates.csv", list(rows_of(rates, kept, speeds)))
    print_rates(rates, kept, speeds)
    print_claims(rates, kept, speeds)
    felt = {name: one for name, one in drives().items() if not only or name in only}
    driven = list(by_drive(felt, solid))
    write_table(folder / "drives.csv", [one.row() for one in driven])
    print_drives(driven, middle_of(solid).name)
    draw(folder / "textures.png", rates, kept, driven)


def rows_of(rates: RatesOf, kept: Sequence[Kept], speeds: Sequence[float]) -> Iterator[Rate]:
    """Yield all rates."""
    for kind, target in recorded().items():
        for i, speed in enumerate(speeds):
            for j, one in enumerate(kept):
                for k, surface in enumerate(NAMES):
                    value = float(rates[kind][i, j, k])
                    if np.isfinite(value):
                        yield Rate(one.name, kind, speed, surface, float(target[k]), value)


def print_rates(rates: RatesOf, kept: Sequence[Kept], speeds: Sequence[float]) -> None:
    """Print the rates on all surfaces, a row for each kind, file and speed."""
    print(f"{'spikes/s':52s}" + "".join(f"{name:>11s}" for name in NAMES))
    for kind, target in recorded().items():
        print(f"{kind + ', recorded':52s}" + "".join(f"{rate:11.0f}" for rate in target))
        for j, one in enumerate(kept):
            for i, speed in enumerate(speeds):
                row = f"{kind}, {one.name}, {speed:g} mm/s"
                print(f"{row:52s}" + "".join(f"{rate:11.0f}" for rate in rates[kind][i, j]))


def print_claims(rates: RatesOf, kept: Sequence[Kept], speeds: Sequence[float]) -> None:
    """Print which claims hold, and where; files that lack a surface of the claim do not count."""
    target = recorded()
    print("\n| claim | recorded | model | holds | where |\n| --- | --- | --- | --- | --- |")
    for claim in CLAIMS:
        wanted = claim.of(target[claim.kind], target["SA1"])
        found = {
            f"{one.name} {speed:g}": claim.of(rates[claim.kind][i, j], rates["SA1"][i, j])
            for j, one in enumerate(kept)
            if one.serves(claim.kind)
            for i, speed in enumerate(speeds)
        }
        found = {where: value for where, value in found.items() if np.isfinite(value)}
        held = [where for where, value in found.items() if claim.holds(value, wanted)]
        ends = f"{min(found.values()):.2f} to {max(found.values()):.2f}" if found else ""
        print(
            f"| {claim.text} ({claim.agrees}) | {wanted:.2f} | {ends} | {len(held)} of "
            f"{len(found)} | {'; '.join(held) or 'nowhere'} |"
        )


# %% [markdown]
# Each drive has its own gain, compression and adaptation, fitted to bar and spheres, once with
# compression and once without. Points of a cluster share the constants of the average over
# 0.25 mm. A difference is zero under the middle of a sphere, so it is fitted to the bar alone.


# %%
def by_drive(felt: dict[str, Felt], kept: Sequence[Kept]) -> Iterator[Driven]:
    """Yield the rates of every drive at 80 mm/s."""
    both = [one for one in kept if {"grating_3", "dots_2"} <= set(one.surfaces)]
    for name, drive in felt.items():
        for linear in (False, True):
            neuron, *r2 = drive.fitted(linear)
            rates = mean_rates(both, "SA1", DRIVES_MM_S, key=drive.key, neuron=neuron)
            law = "linear" if linear else "compressed"
            for one, own in zip(both, rates, strict=True):
                dots, grating = (one.get(on, drive.key).mean() for on in ("dots_2", "grating_3"))
                yield Driven(name, law, *r2, one.name, own, float(dots / grating))


def print_drives(some: Sequence[Driven], middle: str) -> None:
    """Print rates in the middle condition by each drive, and a ratio in all conditions."""
    target = recorded()["SA1"]
    print(
        f"\n{f'SA1, {middle}, {DRIVES_MM_S:g} mm/s':40s}R2 of bar, spheres  r    {'':3s}"
        + " ".join(NAMES)
    )
    print(f"{'recorded':69s}" + "".join(f"{rate:5.0f}" for rate in target))
    for one in some:
        if one.histories == middle:
            of = f"{one.drive}, {one.law}"
            known = f"{one.r2_bar:8.2f}{one.r2_spheres:8.2f}{one.r:8.2f}"
            print(f"{of:40s}{known:29s}" + "".join(f"{rate:5.0f}" for rate in one.rates))
    wanted = ratio("dots_2", "grating_3")(target, target)
    each = ", ".join(dict.fromkeys(one.histories for one in some))
    print(f"\n2 mm dots over 3 mm grating; recorded {wanted:.1f}; in {each}")
    dots, grating = NAMES.index("dots_2"), NAMES.index("grating_3")
    for name, law in dict.fromkeys((one.drive, one.law) for one in some):
        own = [one for one in some if (one.drive, one.law) == (name, law)]
        each = ", ".join(f"{one.ratio:.1f} (drive {one.ratio_of_drive:.1f})" for one in own)
        rates = np.array([one.rates for one in own])
        apart = f"{rates[:, dots].max():.0f} over {rates[:, grating].min():.0f} spikes/s"
        print(f"{name}, {law}: {each}; {apart} if heights and forces are not the same")


# %%
def draw(picture: Path, rates: RatesOf, kept: Sequence[Kept], driven: Sequence[Driven]) -> None:
    """Draw rates beside recorded ones, and the ratios that drives make."""
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    *panels, last = figure.subplots(1, 4, width_ratios=(1, 1, 1, 1.1))
    middle = middle_of([one for one in kept if one.serves("SA1")])
    for axes, kind in zip(panels, KINDS, strict=True):
        serving = [one.serves(kind) for one in kept]
        shown = [one.serves("PC") if kind == "PC" else one is middle for one in kept]
        draw_kind(axes, rates[kind][:, serving], rates[kind][:, shown], recorded()[kind])
        axes.set_title(kind)
    panels[0].set_ylabel("Mean rate (spikes/s)")
    for one in driven:
        shown = (one.drive, one.law, one.histories) == (*SHARPEST, middle.name)
        if shown:
            label = f"{one.drive}, {one.law}"
            draw_line(panels[0], one.rates, "^:", color=ORANGE, ms=4, label=label)
    panels[0].legend(frameon=False, fontsize=7, loc="upper left")
    panels[0].set_ylim(0, 1.5 * panels[0].get_ylim()[1])
    draw_drives(last, driven, middle.name)
    figure.savefig(picture, dpi=120)


def middle_of(kept: Sequence[Kept]) -> Kept:
    """Return the file of the middle height and force, of the finer mesh if it has all surfaces."""
    whole = {one.name: one for one in kept if len(one.surfaces) == len(NAMES)}
    return whole.get(FINE) or whole.get(COARSE) or kept[0]


def draw_line(axes: Axes, rates: Array, style: str, label: str, **how: Any) -> None:
    """Draw rates on gratings and on dots as two lines."""
    for number, part in enumerate((GRATINGS, DOTS)):
        at = np.arange(8)[part] + number
        axes.plot(at, rates[part], style, label="" if number else label, **how)


def draw_kind(axes: Axes, rates: Array, middle: Array, target: Array) -> None:
    """Draw the range of the rates, those of the middle condition and the recorded ones."""
    every = rates.reshape(-1, 8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # surfaces that no file has
        low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
        line = np.nanmean(middle.reshape(-1, 8), axis=0)
    for number, part in enumerate((GRATINGS, DOTS)):
        at = np.arange(8)[part] + number
        label = "" if number else "all heights, forces, speeds"
        axes.fill_between(at, low[part], high[part], color=BLUE, alpha=0.2, lw=0, label=label)
    draw_line(axes, line, "s-", color=BLUE, label="0.5 mm, 0.3 N")
    draw_line(axes, target, "o--", color=INK, mfc="white", label="recorded")
    periods = [name.split("_")[1] for name in NAMES]
    axes.set_xticks([0, 1, 2, 3, 5, 6, 7, 8], periods)
    axes.set_xlabel("Period (mm): gratings, dots")
    axes.set_ylim(0, None)
    axes.spines[["top", "right"]].set_visible(False)


def draw_drives(axes: Axes, driven: Sequence[Driven], middle: str) -> None:
    """Draw for each drive the ratio of rates in all conditions."""
    names = list(dict.fromkeys(one.drive for one in driven))
    for one in driven:
        color = BLUE if one.histories == middle else GREY
        face = color if one.law == "compressed" else "white"
        at = names.index(one.drive) + (0.15 if one.law == "linear" else -0.15)
        axes.plot(one.ratio, at, "o", ms=5, color=color, mfc=face, zorder=3 if color == BLUE else 2)
    target = dict(zip(NAMES, recorded()["SA1"], strict=True))
    axes.axvline(target["dots_2"] / target["grating_3"], color=INK, ls="--")
    axes.plot([], [], "o", color=GREY, label="compressed")
    axes.plot([], [], "o", color=GREY, mfc="white", label="linear")
    axes.legend(frameon=False, fontsize=7, loc="lower right")
    axes.set(xscale="log", xlim=(0.3, 100), title="SA1 by their drive")
    axes.set_xlabel("2 mm dots over 3 mm grating")
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.set_xticks([0.5, 1, 2, 5, 10, 20], ["0.5", "1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)


# %%
if __name__ == "__main__":
    run_script(main)
