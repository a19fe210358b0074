"""Measured firing rates, and what the receptors felt in the same experiments on the model finger.

All rates are of slowly adapting afferents, read from published figures by third parties. In
`measured/rates` those of monkeys:

- `bar.csv`, `bar_again.csv`, `grating.csv`: a bar 3 mm wide and an aperiodic grating, 1 mm deep
  (Phillips and Johnson 1981); the bar's rates in the hold were read twice,
- `spheres.csv`: spikes in the first second (Goodwin, Browning and Wheat 1995),
- `probe.csv`: area in which a probe of 0.5 mm diameter makes an afferent fire,
- `decline.csv`: shares of the rate that are left after 12 s of a hold that follows a ramp of 0.4
  mm/s, means of 21 afferents (Burgess et al. 1983, https://www.jneurosci.org/content/3/12/2652),
- `textures.csv`: mean rates of 39 afferents on gratings and dots on a drum,
- `periodic.csv`: rates under gratings 0.325 mm deep over the mean of all, read by eye, +- 0.1
  (Bensmaia et al. 2006),

and those of people:

- `unit_a.csv`, `unit_b.csv`: spikes in the first 0.12 s of a ramp of 72 mm/s and a hold, and rates
  from 0.5 to 0.95 s (Knibestöl 1975). The probe is not known; it is assumed to be flat.

The histories of what was felt come from `histories.py` and `texture_histories.py`.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tactile_fem.neuron import Drive, Recording, Window

Array = NDArray[Any]

MEASURED = Path(__file__).parent / "measured" / "rates"
HISTORIES = Path(__file__).parent / "histories"
# Assumed: the ramp of all presses, the hold; static rates are those of its second half.
RAMP_S, HOLD_S = 0.05, 1.0
RAMP_VALUES = 51
RAMP, HOLD = (0.0, RAMP_S), (RAMP_S + HOLD_S / 2, RAMP_S + HOLD_S)
FIRST_SECOND = (0.0, 1.0)
# Human units and the decline over seconds; the radius of the punch is assumed.
ONSET, LATE = (0.0, 0.12), (0.5, 0.95)
RAMP_MM_S, SLOW_RAMP_MM_S = 72.0, 0.4
PUNCH_MM, PUNCHES_MM, DECLINE_S, DECLINE_SD = 1.0, (0.5, 1.0, 1.5), 12.0, 0.05
# Periods of gratings and of square lattices of dots on the drum. Height, mm, and force, N, as in
# scripts of the laboratory; the speed is assumed, and the time on each surface.
SURFACES = {
    **{f"grating_{period}": float(period) for period in (12, 8, 5, 3)},
    **{f"dots_{period}": float(period) for period in (6, 4, 3, 2)},
}
AS_RECORDED, SPEED_MM_S, CONTACT_S, VALUES_PER_PERIOD = "0.74mm_0.5N", 80.0, 300.0, 48


def measured(name: str) -> dict[str, Array]:
    """Return the columns of a table of measurements."""
    with (MEASURED / f"{name}.csv").open(newline="", encoding="utf-8") as stream:
        heading, *rows = csv.reader(stream)
    return dict(zip(heading, np.array(rows, dtype=float).T, strict=True))


@dataclass(frozen=True)
class Felt:
    """What receptors felt while a stimulus was pressed.

    Attributes
    ----------
    time_s, depth_mm, force_N
        (t,), from first touch.
    x_mm, y_mm
        Places of the receptors, (receptors,).
    drive
        What they answer to, (t, receptors).
    """

    time_s: Array
    depth_mm: Array
    force_N: Array
    x_mm: Array
    y_mm: Array
    drive: Array

    @classmethod
    def of(cls, name: str, drive: Drive) -> Felt:
        """Read one of `histories.py`'s files."""
        with np.load(HISTORIES / f"{name}.npz") as stored:
            arrays = {key: stored[key] for key in stored.files}
        time_s, felt = drive.of(arrays)
        places = (arrays[key] for key in ("depth_mm", "force_N", "x_mm", "y_mm"))
        return cls(time_s, *places, felt)

    def along(self, y_mm: Array) -> Array:
        """Return the receptors at places along the finger."""
        middle = np.abs(self.x_mm) < 1e-6
        away = np.abs(self.y_mm[:, None] - y_mm) + np.where(middle, 0.0, np.inf)[:, None]
        return away.argmin(axis=0)

    def held(self, receptors: Array) -> tuple[Array, Array]:
        """Return a fast press, with the hold extended to its whole length."""
        felt = self.drive[:, receptors]
        return np.append(self.time_s, RAMP_S + HOLD_S), np.vstack([felt, felt[-1:]])

    def held_at(
        self, when_s: float, receptors: Array, ramp_s: float = RAMP_S, hold_s: float = HOLD_S
    ) -> tuple[Array, Array]:
        """Return a slow press up to a time, as if it had taken the ramp's time, and a hold."""
        felt, before = self.drive[:, receptors], self.time_s < when_s - 1e-9
        last = np.array([np.interp(when_s, self.time_s, one) for one in felt.T])
        time = np.append(self.time_s[before], when_s) * ramp_s / when_s
        return np.append(time, ramp_s + hold_s), np.vstack([felt[before], last, last])

    def when_depth(self, depth_mm: float) -> float:
        """Return the time, s, at which a press comes to a depth."""
        return float(np.interp(depth_mm, self.depth_mm, self.time_s))

    @property
    def middle(self) -> Array:
        """The receptors under the middle of a stimulus."""
        return np.flatnonzero(np.hypot(self.x_mm, self.y_mm) < 0.15)

    def when_force(self, force_N: float) -> float:
        """Return the time, s, at which a press comes to a force."""
        return float(np.interp(force_N, np.maximum.accumulate(self.force_N), self.time_s))


def bar(drive: Drive) -> Recording:
    """Return the bar's ramp and hold.

    A deviation is measured by the standard deviation of the rates between positions, so that ramp,
    hold and spheres count by the share of their variance that is explained.
    """
    table = measured("bar")
    felt = Felt.of("bar", drive)
    time, values = felt.held(felt.along(table["y_mm"]))
    windows = [
        Window(*when, table[key], table[key].std())
        for when, key in ((RAMP, "ramp_Hz"), (HOLD, "hold_Hz"))
    ]
    return Recording(time, values, windows)


def bar_again(drive: Drive) -> Recording:
    """Return the second reading of the bar's hold."""
    table = measured("bar_again")
    felt = Felt.of("bar", drive)
    time, values = felt.held(felt.along(table["y_mm"]))
    return Recording(time, values, [Window(*HOLD, table["hold_Hz"])])


def spheres(drive: Drive) -> list[Recording]:
    """Return one recording of all spheres and forces, which are taken for receptors."""
    table = measured("spheres")
    rates = table["first_second_Hz"]
    time, columns = np.append(np.linspace(0.0, RAMP_S, RAMP_VALUES), RAMP_S + HOLD_S), []
    for curvature, force, _ in zip(*table.values(), strict=True):
        felt = Felt.of(f"sphere_{curvature:g}", drive)
        at, values = felt.held_at(felt.when_force(force), felt.middle)
        columns.append(np.interp(time, at, values.mean(axis=1)))
    return [Recording(time, np.column_stack(columns), [Window(*FIRST_SECOND, rates, rates.std())])]


def human_unit(drive: Drive, name: str, radius_mm: float = PUNCH_MM) -> list[Recording]:
    """Return a recording of human unit "a" or "b" for each depth."""
    table = measured(f"unit_{name}")
    onset, late = table["spikes"] / ONSET[1], table["hold_Hz"]
    found = []
    for depth, *rates in zip(table["depth_mm"], onset, late, strict=True):
        time, values = punched(drive, depth, radius_mm)
        sds = onset.std(), late.std()
        parts = zip((ONSET, LATE), rates, sds, strict=True)
        windows = [Window(*when, [rate], sd) for when, rate, sd in parts]
        found.append(Recording(time, values, windows, afferent=f"human {name}"))
    return found


def decline(drive: Drive) -> list[Recording]:
    """Return recordings of the decline in a hold: rates relative to those in its first second."""
    found = []
    for depth, left in zip(*measured("decline").values(), strict=True):
        start = depth / SLOW_RAMP_MM_S
        time, values = pressed(Felt.of("hold", drive), depth, SLOW_RAMP_MM_S, DECLINE_S)
        end = start + DECLINE_S
        first = Window(start, start + 1.0, [1.0], DECLINE_SD)
        last = Window(end - 1.0, end, [left], DECLINE_SD)
        found.append(Recording(time, values, [first, last], relative=True))
    return found


def punched(drive: Drive, depth_mm: float, radius_mm: float) -> tuple[Array, Array]:
    """Return the history under the middle of a punch that is pressed into a person's finger."""
    return pressed(Felt.of(f"punch_{radius_mm:g}", drive), depth_mm, RAMP_MM_S, HOLD_S)


def pressed(felt: Felt, depth_mm: float, speed_mm_s: float, hold_s: float) -> tuple[Array, Array]:
    """Return the history under the middle of what is pressed to a depth at a speed, and held."""
    ramp_s = depth_mm / speed_mm_s
    time, values = felt.held_at(felt.when_depth(depth_mm), felt.middle, ramp_s, hold_s)
    return time, values.mean(axis=1, keepdims=True)


def textures(drive: Drive, condition: str = AS_RECORDED) -> list[Recording]:
    """Return a recording for each surface that is kept of a height and force.

    The receptors have slid on it for some minutes (assumed) and slide for two periods, of which the
    second counts. The rates are means over receptors, as the recorded ones are over afferents.
    """
    kept = Kept.of(HISTORIES / "textures" / f"{condition}.npz")
    rates = recorded_on_textures("SA1")
    found = []
    for name, rate in zip(SURFACES, rates, strict=True):
        if name not in kept.surfaces:
            continue
        period = SURFACES[name]
        slide = np.linspace(0.0, 2 * period, 2 * VALUES_PER_PERIOD + 1)
        values = kept.felt(name, drive, slide)
        time = slide / SPEED_MM_S
        last = Window(time[-1] / 2, time[-1], [rate], rates.std())
        found.append(Recording(time, values, [last], pooled=True, contact_s=CONTACT_S))
    return found


def recorded_on_textures(kind: str) -> Array:
    """Return the recorded rates of a kind, spikes/s, on all surfaces in their order."""
    with (MEASURED / "textures.csv").open(newline="", encoding="utf-8") as stream:
        rows = {row["surface"]: row for row in csv.DictReader(stream)}
    return np.array([float(rows[name][f"{kind}_Hz"]) for name in SURFACES])


@dataclass(frozen=True)
class Kept:
    """One period of what is felt on some surfaces, from a file."""

    name: str
    arrays: dict[str, Array]

    @classmethod
    def of(cls, path: Path) -> Kept:
        """Read a file of `texture_histories.py`; one that does not exist holds no surface."""
        if not path.exists():
            return cls(path.stem, {})
        with np.load(path) as stored:
            return cls(path.stem, {key: stored[key] for key in stored.files})

    @property
    def surfaces(self) -> tuple[str, ...]:
        """The surfaces, in the order of the table."""
        return tuple(name for name in SURFACES if f"{name}.slide_mm" in self.arrays)

    def felt(self, surface: str, drive: Drive, slide_mm: Array) -> Array:
        """Return what is felt anywhere on the way, by a periodic cubic spline."""
        own = f"{surface}."
        arrays = {k.removeprefix(own): v for k, v in self.arrays.items() if k.startswith(own)}
        at, period = arrays["slide_mm"].astype(float), SURFACES[surface]
        _, felt = drive.of(arrays | {"time_s": at})
        # What is left of the run-in is taken away, so that the period ends as it begins.
        values = felt + (1 - at / at[-1])[:, None] * (felt[-1] - felt[0])
        values[-1] = values[0]
        spline = CubicSpline(at * period / at[-1], values, bc_type="periodic")
        return np.maximum(spline(np.mod(slide_mm, period)), values.min())


def grating(drive: Drive) -> list[Recording]:
    """Return a recording for each place on the aperiodic grating."""
    table = measured("grating")
    centres = {
        float(path.stem.split("_")[1]): path.stem for path in HISTORIES.glob("grating_*.npz")
    }
    found = []
    for place, rate in zip(*table.values(), strict=True):
        centre = min(centres, key=lambda centre: abs(centre - place))
        felt = Felt.of(centres[centre], drive)
        time, values = felt.held(felt.along(np.array([place - centre])))
        found.append(Recording(time, values, [Window(*HOLD, [rate])]))
    return found


def periodic(drive: Drive) -> list[Recording]:
    """Return recordings of gratings: rates in the hold relative to the mean, (phases,) each."""
    table = measured("periodic")
    found = []
    for period, *relative in zip(*table.values(), strict=True):
        columns = []
        for phase in list(table)[1:]:
            felt = Felt.of(f"periodic_{period:g}_{phase}", drive)
            time, values = felt.held(felt.along(np.zeros(1)))
            columns.append((time, values))
        time = np.linspace(0.0, RAMP_S + HOLD_S, 421)
        together = np.column_stack([np.interp(time, at, one[:, 0]) for at, one in columns])
        found.append(Recording(time, together, [Window(*HOLD, relative)]))
    return found


def cylinders(drive: Drive) -> dict[float, tuple[Array, Array]]:
    """Return the histories under the axes of cylinders, by radius in mm."""
    found = {}
    for path in HISTORIES.glob("cylinder_*.npz"):
        felt = Felt.of(path.stem, drive)
        found[float(path.stem.split("_")[1])] = felt.held(felt.along(np.zeros(1)))
    return dict(sorted(found.items()))


def probe(drive: Drive, depth_mm: float) -> tuple[Felt, Array, Array]:
    """Return what was felt, and the histories of all receptors around a probe at a depth."""
    felt = Felt.of("probe", drive)
    return felt, *felt.held_at(felt.when_depth(depth_mm), np.arange(len(felt.x_mm)))


def rates_of(some: Sequence[Recording]) -> Array:
    """Return the measured rates in all windows, one after another, spikes/s."""
    return np.concatenate([window.rate_Hz for r in some for window in r.windows])
