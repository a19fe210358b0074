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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

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
BLUE, ORANGE, GREEN, INK, GREY = "#0072B2", "#D55E00", "#009E73", "#222222", "#9A9A9A"
LEVEL = 1.3  # the largest rate over the smallest, if rates are level; recorded: 1.2
FACTOR = 2.0  # within which a ratio agrees
FINE, COARSE = "solid_medium_0.5mm_0.3N", "solid_coarse_0.5mm_0.3N"
DRIVES_MM_S = 80.0

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
class Separation:
    """What SA1 afferents with a drive make of a grating of 3 mm and dots 2 mm apart."""

    drive: str
    r2_bar: float
    r2_spheres: float
    histories: str
    grating_3_Hz: float
    dots_2_Hz: float
    ratio: float
    ratio_of_drive: float


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
    """Return rates of which none is 0, to divide by."""
    return np.maximum(rates, 0.1)


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
    Claim("PC: dots, most over least", "PC", spread(DOTS), "level"),
    Claim(
        "PC over SA1, mean", "PC", lambda rates, sa1: float((rates / floored(sa1)).mean()), "ratio"
    ),
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
        For tables and figure.
    histories
        Folder of `texture_histories.py`.
    speeds
        mm/s.
    only
        Drives of SA1 that are compared, all unless named.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept = [Kept.of(path) for path in sorted(histories.glob("*.npz"))]
    solid = [one for one in kept if one.name.startswith("solid") and one.is_standard]
    rates = {kind: np.array([mean_rates(kept, kind, speed) for speed in speeds]) for kind in KINDS}
    write_table(folder / "rates.csv", list(rows_of(rates, kept, speeds)))
    print_rates(rates, kept, speeds)
    chosen = [kept.index(one) for one in solid]
    print_claims({kind: each[:, chosen] for kind, each in rates.items()}, solid, speeds)
    felt = {name: one for name, one in drives().items() if not only or name in only}
    separations = list(separated(felt, solid))
    write_table(folder / "drives.csv", separations)
    print_separations(separations)
    draw(folder / "textures.png", {k: r[:, chosen] for k, r in rates.items()}, solid, separations)


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
    """Print which claims hold, and where; files in which a surface is missing do not count."""
    target = recorded()
    whole = [j for j, one in enumerate(kept) if len(one.surfaces) == len(NAMES)]
    print("\n| claim | recorded | model | holds | where |\n| --- | --- | --- | --- | --- |")
    for claim in CLAIMS:
        wanted = claim.of(target[claim.kind], target["SA1"])
        found, where = [], []
        for j in whole:
            for i, speed in enumerate(speeds):
                found.append(claim.of(rates[claim.kind][i, j], rates["SA1"][i, j]))
                if claim.holds(found[-1], wanted):
                    where.append(f"{kept[j].name} {speed:g}")
        ends = f"{min(found):.2f} to {max(found):.2f}" if found else ""
        print(
            f"| {claim.text} ({claim.agrees}) | {wanted:.2f} | {ends} | {len(where)} of "
            f"{len(found)} | {'; '.join(where) or 'nowhere'} |"
        )


# %% [markdown]
# Each drive has its own gain, compression and adaptation, fitted to bar and spheres. Points of a
# cluster share those of the average over 0.25 mm.


# %%
def separated(felt: dict[str, Felt], kept: Sequence[Kept]) -> Iterator[Separation]:
    """Yield the rates of every drive on both surfaces, at 80 mm/s."""
    both = [one for one in kept if {"grating_3", "dots_2"} <= set(one.surfaces)]
    i, j = NAMES.index("grating_3"), NAMES.index("dots_2")
    for name, drive in felt.items():
        neuron, bar, spheres = drive.neuron()
        rates = mean_rates(both, "SA1", DRIVES_MM_S, key=drive.key, neuron=neuron)
        for one, own in zip(both, rates, strict=True):
            grating, dots = own[i], own[j]
            means = [one.get(surface, drive.key).mean() for surface in ("dots_2", "grating_3")]
            yield Separation(
                name,
                bar,
                spheres,
                one.name,
                float(grating),
                float(dots),
                float(dots / max(grating, 0.1)),
                float(means[0] / means[1]),
            )


def print_separations(rows: Sequence[Separation]) -> None:
    """Print what each drive makes of the two surfaces, in all conditions and at best."""
    target = dict(zip(NAMES, recorded()["SA1"], strict=True))
    wanted = target["dots_2"] / target["grating_3"]
    print(
        f"\nSA1, 2 mm dots over 3 mm grating at {DRIVES_MM_S:g} mm/s; recorded "
        f"{target['dots_2']:g} / {target['grating_3']:g} = {wanted:.1f}"
    )
    for name in dict.fromkeys(row.drive for row in rows):
        own = [row for row in rows if row.drive == name]
        each = ", ".join(
            f"{row.histories.removeprefix('solid_')} {row.dots_2_Hz:.0f}/{row.grating_3_Hz:.0f} = "
            f"{row.ratio:.1f} (drive {row.ratio_of_drive:.1f})"
            for row in own
        )
        print(f"{name} (R2 of bar {own[0].r2_bar:.2f}, spheres {own[0].r2_spheres:.2f}): {each}")


# %%
def draw(picture: Path, rates: RatesOf, kept: Sequence[Kept], rows: Sequence[Separation]) -> None:
    """Draw rates beside recorded ones, and the ratios that drives make."""
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    *panels, last = figure.subplots(1, 4, width_ratios=(1, 1, 1, 1.1))
    for axes, kind in zip(panels, KINDS, strict=True):
        draw_kind(axes, rates[kind], kept, recorded()[kind])
        axes.set_title(kind)
    panels[0].set_ylabel("Mean rate (spikes/s)")
    panels[0].legend(frameon=False, fontsize=7, loc="upper left")
    draw_separations(last, rows)
    figure.savefig(picture, dpi=120)


def draw_kind(axes: Axes, rates: Array, kept: Sequence[Kept], target: Array) -> None:
    """Draw the range of the rates, those of the middle condition and the recorded ones."""
    names = [one.name for one in kept]
    middle = names.index(FINE if FINE in names else names[0])
    for number, part in enumerate((GRATINGS, DOTS)):
        at = np.arange(8)[part] + number
        own = rates[:, :, part].reshape(-1, 4)
        low, high = np.nanmin(own, axis=0), np.nanmax(own, axis=0)
        labels = ("all heights, forces, speeds", "0.5 mm, 0.3 N", "recorded")
        labels = labels if not number else (None, None, None)
        axes.fill_between(at, low, high, color=BLUE, alpha=0.2, lw=0, label=labels[0])
        axes.plot(at, np.nanmean(rates[:, middle, part], axis=0), "s-", color=BLUE, label=labels[1])
        axes.plot(at, target[part], "o--", color=INK, mfc="white", label=labels[2])
    periods = [name.split("_")[1] for name in NAMES]
    axes.set_xticks([0, 1, 2, 3, 5, 6, 7, 8], periods)
    axes.set_xlabel("Period (mm): gratings, dots")
    axes.set_ylim(0, None)
    axes.spines[["top", "right"]].set_visible(False)


def draw_separations(axes: Axes, rows: Sequence[Separation]) -> None:
    """Draw for each drive the ratio of rates in all conditions."""
    names = list(dict.fromkeys(row.drive for row in rows))
    for row in rows:
        fine = row.histories == FINE
        style = {"color": BLUE, "ms": 6} if fine else {"color": GREY, "ms": 4}
        axes.plot(
            max(row.ratio, 0.1), names.index(row.drive), "o", zorder=3 if fine else 2, **style
        )
    target = dict(zip(NAMES, recorded()["SA1"], strict=True))
    axes.axvline(target["dots_2"] / target["grating_3"], color=INK, ls="--")
    axes.set(xscale="log", title="SA1 by their drive")
    axes.set_xlabel("Rate on 2 mm dots over 3 mm grating")
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.set_xticks([0.2, 0.5, 1, 2, 5, 10], ["0.2", "0.5", "1", "2", "5", "10"])
    axes.minorticks_off()
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)


# %%
if __name__ == "__main__":
    run_script(main)
