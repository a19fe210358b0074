# %% [markdown]
# # Firing on gratings and dots that slide under a monkey's finger, beside recorded rates
#
# Recorded (`measured/rates/textures.csv`): mean rates of 39 afferents of monkeys on a drum with
# gratings of period 12, 8, 5, 3 mm and dots on square lattices of 6, 4, 3, 2 mm. The default SA1 is
# fitted to these and other rates (`calibrate.py`); RA and PC are predicted. What of the speed, the
# gratings' heights and the force is not known is varied. What is felt comes from
# `texture_histories.py`.
#
#     python demos/validation/textures.py results/textures
#     python demos/validation/textures.py results/textures --histories results/histories --speeds 80

# %%
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from recordings import AS_RECORDED, HISTORIES, SURFACES, Array, Kept, recorded_on_textures
from texture_firing import DRIVES, mean_rates

from tactile_fem import run_script, write_table

NAMES = tuple(SURFACES)
GRATINGS, DOTS = slice(0, 4), slice(4, 8)
BLUE, INK = "#0072B2", "#222222"
LEVEL = 1.3  # the largest rate over the smallest, if rates are level; recorded: 1.2
FACTOR = 2.0  # within which a ratio agrees

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
    histories: Path = HISTORIES / "textures",
    speeds: tuple[float, ...] = (40.0, 80.0, 120.0),
) -> None:
    """Fire, compare and draw.

    Parameters
    ----------
    folder
        Folder for table and figure.
    histories
        Folder of `texture_histories.py`.
    speeds
        Speeds in mm/s.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept = [Kept.of(path) for path in sorted(histories.glob("*.npz"))]
    rates = {kind: np.array([mean_rates(kept, kind, speed) for speed in speeds]) for kind in DRIVES}
    write_table(folder / "rates.csv", list(rows_of(rates, kept, speeds)))
    print_rates(rates, kept, speeds)
    print_claims(rates, kept, speeds)
    draw(folder / "textures.png", rates, [one.name for one in kept])


def recorded() -> dict[str, Array]:
    """Return the recorded rates of each kind, spikes/s, on all surfaces in their order."""
    return {kind: recorded_on_textures(kind) for kind in DRIVES}


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
            for i, speed in enumerate(speeds)
        }
        found = {where: value for where, value in found.items() if np.isfinite(value)}
        held = [where for where, value in found.items() if claim.holds(value, wanted)]
        ends = f"{min(found.values()):.2f} to {max(found.values()):.2f}" if found else ""
        print(
            f"| {claim.text} ({claim.agrees}) | {wanted:.2f} | {ends} | {len(held)} of "
            f"{len(found)} | {'; '.join(held) or 'nowhere'} |"
        )


# %%
def draw(picture: Path, rates: RatesOf, names: Sequence[str]) -> None:
    """Draw rates as recorded, those of the variants behind them, beside recorded ones."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for axes, kind in zip(figure.subplots(1, 3), DRIVES, strict=True):
        own = rates[kind].transpose(1, 0, 2)  # (files, speeds, surfaces)
        middle = own[names.index(AS_RECORDED) if AS_RECORDED in names else 0]
        for variant in own.reshape(-1, 8):
            draw_line(axes, variant, "-", color=BLUE, alpha=0.15)
        draw_line(axes, middle[len(middle) // 2], "s-", color=BLUE, label="model")
        draw_line(axes, recorded()[kind], "o--", color=INK, mfc="white", label="recorded")
        periods = [name.split("_")[1] for name in NAMES]
        axes.set_xticks([0, 1, 2, 3, 5, 6, 7, 8], periods)
        axes.set(xlabel="Period (mm): gratings, dots", title=kind, ylim=(0, None))
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("Mean rate (spikes/s)")
    figure.axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    figure.savefig(picture, dpi=120)


def draw_line(axes: Axes, rates: Array, style: str, label: str = "", **how: Any) -> None:
    """Draw rates on gratings and on dots as two lines."""
    for number, part in enumerate((GRATINGS, DOTS)):
        at = np.arange(8)[part] + number
        axes.plot(at, rates[part], style, label="" if number else label, **how)


# %%
if __name__ == "__main__":
    run_script(main)
