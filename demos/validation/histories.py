# %% [markdown]
# # What receptors feel in the experiments whose rates are known
#
# Experiments with monkeys' finger pads are repeated on the study `macaque`, and what receptors feel
# is kept in small files for work on neurons alone:
#
# - a bar 3 mm wide, pressed 1 mm deep at different distances from an afferent, and an aperiodic
#   grating, at different places (Phillips and Johnson 1981),
# - spheres and a plate, pressed with 98, 147 and 196 mN (Goodwin, Browning and Wheat 1995),
# - cylinders of 16, 8, 4, 2 per inch, 1 mm deep; a probe of 0.5 mm diameter, 50 to 500 µm deep,
# - a flat-ended punch of 2 mm diameter (assumed), for holds of 12 s (Burgess et al. 1983),
# - gratings of periods 1 to 10 mm, 0.325 mm deep, with the middle of a ridge, an edge or the middle
#   of a groove under the afferent (Bensmaia et al. 2006).
#
# And on the default finger those with people:
#
# - flat-ended punches of 1, 2 and 3 mm diameter, to 3.2 mm (Knibestöl 1975),
# - the letters of the default scan.
#
# The bar is pressed once, across the finger, and receptors lie at all these distances; the skin at
# $y$ lies $y^2/33$ mm higher than the apex. Gratings are moved instead. Presses to one depth take
# 50 ms (assumed) and are held; tissues do not relax. Presses to several forces or depths are slow,
# because spikes were counted while the stimulus rested.
#
#     python demos/validation/histories.py results/histories
#     python demos/validation/histories.py results/histories --stimuli bar --pad-size 0.8
#
# It writes `bar.npz`, `sphere_521.npz` ... with the columns of `felt_quantities.py`. Those in
# `histories/` come from the first command, presses of a quarter of a minute to three minutes, but
# for letters and punches: these are older scans of the same, without areas and clusters.

# %%
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from felt_quantities import END_ORGANS, KEEPS_TENSOR, both
from recordings import PUNCHES_MM

from tactile_fem import Distance, Embossed, Parts, Stimulus, Study, load_study, run_script, scan
from tactile_fem.results.trace import Trace
from tactile_fem.runtime.files import atomic_write
from tactile_fem.study import (
    Cylinder,
    Dots,
    Grating,
    Hold,
    Output,
    Plate,
    Press,
    Protocol,
    Solver,
    Sphere,
)

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

RADII_MM = (1.59, 3.18, 6.35, 12.7)
CURVATURES_PER_M = (0, 81, 172, 256, 340, 521, 694)
FORCES_N = (0.098, 0.147, 0.196)
PROBE_MM = (0.05, 0.1, 0.2, 0.35, 0.5)
EDGES_MM = (
    (1.77, 4.76),
    (5.27, 5.76),
    (6.25, 6.74),
    (7.45, 7.99),
    (8.97, 9.46),
    (10.95, 11.44),
    (13.40, 13.91),
    (16.85, 17.37),
    (22.33, 25.33),
)
CENTRES_MM = (1.77, 3.3, 7.875, 9.75, 11.75, 13.5, 15.0, 17.0, 19.5)
PERIODS_MM, PERIODIC_DEPTH_MM = (1.0, 2.0, 4.0, 6.0, 8.0, 10.0), 0.325
# Place of the apex in a period that begins in the middle of a ridge.
PHASES = {"ridge": 0.0, "edge": 0.25, "groove": 0.5}
DEEP_MM, HELD_MM, HELD_RADIUS_MM = 3.2, 1.4, 1.0
RELIEF_MM, FILLET_MM = 3.0, 0.2
HOLD_S, FAST_MM_S, SLOW_MM_S = 0.05, 20.0, 0.5
SPACING_MM = 0.1
STEP_MM = 0.05


# %%
@dataclass(frozen=True)
class Bars:
    """Parallel bars between given places along the finger, mm; the one at `centre` is at Y = 0."""

    edges: tuple[tuple[float, float], ...]
    centre: float

    @classmethod
    def periodic(cls, period_mm: float, phase: float) -> "Bars":
        """Return ridges as wide as grooves, which reach beyond the finger."""
        count = int(np.ceil(15.0 / period_mm))
        middles = period_mm * np.arange(-count, count + 1)
        low, high = middles - period_mm / 4, middles + period_mm / 4
        return cls(tuple(zip(low.tolist(), high.tolist(), strict=True)), phase * period_mm)

    def distance(self, xy: np.ndarray) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        low, high = np.array(self.edges).T
        offset = xy[:, 1:] + self.centre - (low + high) / 2
        gaps = np.abs(offset) - (high - low) / 2
        rows, nearest = np.arange(len(xy)), gaps.argmin(axis=1)
        gradient = np.zeros_like(xy)
        gradient[:, 1] = np.where(offset[rows, nearest] < 0, -1.0, 1.0)
        return Distance(gaps[rows, nearest], gradient, np.zeros((len(xy), 2, 2)))


def experiments(monkey: Study, human: Study, step: float) -> dict[str, tuple[Study, Parts]]:
    """Return studies and parts by name, for the fingers of two studies."""
    bar = Grating(ridge_mm=3.0, count=1, relief_mm=RELIEF_MM, fillet_radius_mm=FILLET_MM)
    probe = Dots(radius_mm=0.25, rows=1, columns=1, relief_mm=2.0, fillet_radius_mm=0.1)
    fast = Press(depth_mm=1.0, speed_mm_s=FAST_MM_S), Hold(time_s=HOLD_S)
    to_forces = tuple(Press(force_N=force, speed_mm_s=SLOW_MM_S) for force in FORCES_N)
    to_depths = tuple(Press(depth_mm=one, speed_mm_s=SLOW_MM_S) for one in PROBE_MM)
    pressed = partial(study_of_press, monkey, step)
    found = {
        "bar": (pressed(bar, fast, along(3.2)), Parts()),
        "probe": (pressed(probe, to_depths, cross(3.0)), Parts()),
        "hold": (pressed(punch(HELD_RADIUS_MM), slow_to(HELD_MM), cross(0.1)), Parts()),
    }
    for radius in RADII_MM:
        found[f"cylinder_{radius:g}"] = pressed(Cylinder(radius_mm=radius), fast, ()), Parts()
    for curvature in CURVATURES_PER_M:
        ball = Sphere(radius_mm=1e3 / curvature) if curvature else Plate()
        found[f"sphere_{curvature}"] = pressed(ball, to_forces, cross(0.1)), Parts()
    for name, bars, path in gratings(fast):
        fillet = min(FILLET_MM, 0.1 * np.ptp(bars.edges[0]))
        body = Embossed(bars, RELIEF_MM, fillet)
        found[name] = pressed(bar, path, along(0.6)), Parts(body=body)
    for radius in PUNCHES_MM:
        deep = study_of_press(human, step, punch(radius), slow_to(DEEP_MM), cross(0.1))
        found[f"punch_{radius:g}"] = deep, Parts()
    letters = populations({"spacing_mm": 1.0, "half_width_mm": 5.0})
    found["letters"] = Study(finger=human.finger, afferents=letters), Parts()
    return found


def gratings(fast: tuple[Press | Hold, ...]) -> Iterator[tuple[str, Bars, tuple[Any, ...]]]:
    """Yield names, bars and paths of the aperiodic grating, then of the periodic ones."""
    for centre in CENTRES_MM:
        yield f"grating_{centre:g}", Bars(EDGES_MM, centre), fast
    path = Press(depth_mm=PERIODIC_DEPTH_MM, speed_mm_s=FAST_MM_S), Hold(time_s=HOLD_S)
    for period in PERIODS_MM:
        for name, phase in PHASES.items():
            yield f"periodic_{period:g}_{name}", Bars.periodic(period, phase), path


def punch(radius_mm: float) -> Dots:
    """Return a flat-ended punch."""
    return Dots(radius_mm=radius_mm, rows=1, columns=1, relief_mm=5.0, fillet_radius_mm=0.2)


def slow_to(depth_mm: float) -> tuple[Press]:
    """Return the path of a slow press."""
    return (Press(depth_mm=depth_mm, speed_mm_s=SLOW_MM_S),)


def study_of_press(
    base: Study,
    step: float,
    stimulus: Stimulus,
    path: tuple[Press | Hold, ...],
    places: Iterable[tuple[float, float]],
) -> Study:
    """Return the study of a press with receptors at the apex and at other places."""
    return Study(
        finger=base.finger,
        tissue=base.tissue,
        receptors=base.receptors,
        stimulus=stimulus,
        protocol=Protocol(path=path),
        afferents=populations({"half_width_mm": 0.0, "extra_mm": tuple(places)}),
        solver=Solver(first_step_mm=step, max_press_step_mm=step),
        output=Output(pictures=False),
    )


def populations(receptors: dict[str, Any]) -> tuple[dict[str, Any], ...]:
    """Return afferents, and clusters of end organs about the same places."""
    clusters = {"name": "cluster", "receptors": receptors | {"end_organs": END_ORGANS}}
    single = {"name": "SA1", "receptors": receptors}
    return tuple(one | {"feels": KEEPS_TENSOR} for one in (single, clusters))


def along(reach: float) -> Iterable[tuple[float, float]]:
    """Yield places along the finger, mm, but for the apex."""
    for k in range(1, round(reach / SPACING_MM) + 1):
        away = round(k * SPACING_MM, 6)
        yield from ((0.0, -away), (0.0, away))


def cross(reach: float) -> Iterable[tuple[float, float]]:
    """Yield places along and across the finger, mm, but for the apex."""
    for x, y in along(reach):
        yield from ((x, y), (y, x))


# %%
def main(
    folder: Path,
    *,
    stimuli: tuple[str, ...] = (),
    pad_size: float | None = None,
    step: float = STEP_MM,
) -> None:
    """Press each stimulus, all unless named, and save what the receptors feel; lengths in mm.

    Parameters
    ----------
    folder
        Folder for the files; what exists is not computed again.
    stimuli
        Their names.
    pad_size
        Edge of the elements under the contact, of both fingers, instead of their own.
    step
        Longest step of a press.
    """
    folder.mkdir(parents=True, exist_ok=True)
    edges = [f"finger.pad_size_mm={pad_size}"] if pad_size else []
    monkey, human = load_study("macaque", edges), load_study(None, ["finger.preset=medium", *edges])
    known = experiments(monkey, human, step)
    for name in stimuli or known:
        path = folder / f"{name}.npz"
        if path.exists():
            continue
        study, parts = known[name]
        trace = scan(study, parts=parts).trace
        if MPI.COMM_WORLD.rank == 0:
            keep(path, trace)
            print(
                f"{name}: {trace.force_N[-1, 2]:.4f} N at {trace.depth_mm[-1]:.3f} mm, "
                f"SED at most {trace.sed_kPa[-1].max():.4f} kPa",
                flush=True,
            )


def keep(path: Path, trace: Trace) -> None:
    """Write the histories, in single precision."""
    afferents, clusters = (np.flatnonzero(trace.population == name) for name in ("SA1", "cluster"))
    x, y = trace.receptors_mm[afferents, :2].T
    felt = both(trace.arrays(), afferents, clusters)
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(
            stream,
            time_s=trace.time_s - trace.time_s[0],
            depth_mm=trace.depth_mm,
            displacement_mm=trace.displacement_mm,
            force_N=trace.force_N[:, 2],
            x_mm=x.round(6),
            y_mm=y.round(6),
            **{name: values.astype(np.float32) for name, values in felt.items()},
        )


# %%
if __name__ == "__main__":
    run_script(main)
