# %% [markdown]
# # What receptors feel under bar, spheres, cylinders, grating, probe and letters
#
# Experiments with monkeys' finger pads are repeated, and what receptors feel is kept in small files
# for work on neurons alone:
#
# - a bar 3 mm wide, pressed 1 mm deep at different distances from an afferent, and an aperiodic
#   grating, at different places (Phillips and Johnson 1981),
# - spheres and a plate, pressed with 98, 147 and 196 mN (Goodwin, Browning and Wheat 1995),
# - flat-ended punches of 1, 2 and 3 mm diameter, to 3.2 mm, for human afferents (Knibestöl 1975),
# - cylinders of 16, 8, 4, 2 per inch, 1 mm deep; a probe of 0.5 mm diameter, 50 to 500 µm deep,
# - the letters of the default scan.
#
# The bar is pressed once, across the finger, and receptors lie at all these distances; the skin at
# $y$ lies $y^2/58$ mm higher than the apex. The grating is moved instead. Presses to one depth take
# 50 ms (assumed) and are held until the viscous stress has decayed. Presses to several forces or
# depths are slow, because spikes were counted while the stimulus rested.
#
#     python demos/validation/histories.py results/histories
#     python demos/validation/histories.py results/histories --preset coarse --stimuli bar
#
# It writes `bar.npz`, `sphere_521.npz` ... with columns as in `trace.npz`. Those in `histories/`
# come from the first command: 25 presses of one to five minutes on two cores.

# %%
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from recordings import PUNCHES_MM

from tactile_fem import Distance, Embossed, Parts, Stimulus, Study, run_script, scan
from tactile_fem.results.trace import Trace
from tactile_fem.runtime.files import atomic_write
from tactile_fem.study import (
    Cylinder,
    Dots,
    Finger,
    Grating,
    Hold,
    Output,
    Plate,
    Press,
    Protocol,
    Receptors,
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
DEEP_MM = 3.2
RELIEF_MM, FILLET_MM = 3.0, 0.2
HOLD_S, FAST_MM_S, SLOW_MM_S = 0.05, 20.0, 0.5
SPACING_MM = 0.1
FELT = ("sed_kPa", "von_mises_kPa", "stretches", "stresses_kPa")


# %%
@dataclass(frozen=True)
class Bars:
    """Parallel bars between given places along the finger, mm; the one at `centre` is at Y = 0."""

    edges: tuple[tuple[float, float], ...]
    centre: float

    def distance(self, xy: np.ndarray) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        low, high = np.array(self.edges).T
        offset = xy[:, 1:] + self.centre - (low + high) / 2
        gaps = np.abs(offset) - (high - low) / 2
        rows, nearest = np.arange(len(xy)), gaps.argmin(axis=1)
        gradient = np.zeros_like(xy)
        gradient[:, 1] = np.where(offset[rows, nearest] < 0, -1.0, 1.0)
        return Distance(gaps[rows, nearest], gradient, np.zeros((len(xy), 2, 2)))


def experiments(preset: str, depth: float, step: float) -> dict[str, tuple[Study, Parts]]:
    """Return studies and parts by name; bar, cylinders and gratings come to a depth, mm."""
    bar = Grating(ridge_mm=3.0, count=1, relief_mm=RELIEF_MM, fillet_radius_mm=FILLET_MM)
    probe = Dots(radius_mm=0.25, rows=1, columns=1, relief_mm=2.0, fillet_radius_mm=0.1)
    fast = Press(depth_mm=depth, speed_mm_s=FAST_MM_S), Hold(time_s=HOLD_S)
    to_forces = tuple(Press(force_N=force, speed_mm_s=SLOW_MM_S) for force in FORCES_N)
    to_depths = tuple(Press(depth_mm=one, speed_mm_s=SLOW_MM_S) for one in PROBE_MM)
    pressed = partial(study_of_press, preset, step)
    letters = Study(
        finger=Finger(preset=preset),
        receptors=Receptors(spacing_mm=1.0),
        output=Output(pictures=False),
    )
    found = {
        "letters": (letters, Parts()),
        "bar": (pressed(bar, fast, along(4.0)), Parts()),
        "probe": (pressed(probe, to_depths, cross(4.0)), Parts()),
    }
    for radius in RADII_MM:
        cylinder = Cylinder(radius_mm=radius)
        found[f"cylinder_{radius:g}"] = pressed(cylinder, fast, ()), Parts()
    for radius in PUNCHES_MM:
        punch = Dots(radius_mm=radius, rows=1, columns=1, relief_mm=5.0, fillet_radius_mm=0.2)
        deep = (Press(depth_mm=DEEP_MM, speed_mm_s=SLOW_MM_S),)
        found[f"punch_{radius:g}"] = pressed(punch, deep, cross(0.1)), Parts()
    for curvature in CURVATURES_PER_M:
        ball = Sphere(radius_mm=1e3 / curvature) if curvature else Plate()
        found[f"sphere_{curvature}"] = pressed(ball, to_forces, cross(0.1)), Parts()
    for centre in CENTRES_MM:
        body = Embossed(Bars(EDGES_MM, centre), RELIEF_MM, FILLET_MM)
        found[f"grating_{centre:g}"] = pressed(bar, fast, along(0.6)), Parts(body=body)
    return found


def study_of_press(
    preset: str,
    step: float,
    stimulus: Stimulus,
    path: tuple[Press | Hold, ...],
    places: Iterable[tuple[float, float]],
) -> Study:
    """Return the study of a press with receptors at the apex and at other places."""
    return Study(
        finger=Finger(preset=preset),
        stimulus=stimulus,
        protocol=Protocol(path=path),
        receptors=Receptors(half_width_mm=0.0, extra_mm=tuple(places)),
        solver=Solver(first_step_mm=step, max_press_step_mm=step),
        output=Output(pictures=False),
    )


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
    preset: Literal["coarse", "medium", "paper"] = "medium",
    depth: float = 1.0,
    step: float = 0.05,
) -> None:
    """Press each stimulus, all unless named, and save what the receptors feel; lengths in mm."""
    rank = MPI.COMM_WORLD.rank
    folder.mkdir(parents=True, exist_ok=True)
    known = experiments(preset, depth, step)
    for name in stimuli or known:
        study, parts = known[name]
        trace = scan(study, parts=parts).trace
        if rank == 0:
            keep(folder / f"{name}.npz", trace)
            print(
                f"{name}: {trace.force_N[-1, 2]:.4f} N at {trace.depth_mm[-1]:.3f} mm, "
                f"SED at most {trace.sed_kPa[-1].max():.4f} kPa",
                flush=True,
            )


def keep(path: Path, trace: Trace) -> None:
    """Write the histories, in single precision."""
    x, y = trace.receptors_mm[:, :2].T
    arrays = {name: getattr(trace, name).astype(np.float32) for name in FELT}
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(
            stream,
            time_s=trace.time_s - trace.time_s[0],
            depth_mm=trace.depth_mm,
            displacement_mm=trace.displacement_mm,
            force_N=trace.force_N[:, 2],
            x_mm=x.round(6),
            y_mm=y.round(6),
            **arrays,
        )


# %%
if __name__ == "__main__":
    run_script(main)
