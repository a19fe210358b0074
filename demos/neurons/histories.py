# %% [markdown]
# # Strain energy density under a bar and under four cylinders, pressed and held
#
# This demo emphasizes
# - how a row of receptors stands in for one receptor and a stimulus that is moved,
# - how a path is put together from a press and a hold,
# - how histories are kept in a small file for work on neurons alone.
#
# Phillips and Johnson (1981) pressed a bar 3 mm wide 1 mm deep into the finger pads of monkeys,
# repeatedly at different distances $y$ from an afferent. Here the bar is pressed once, and
# receptors lie on the epidermis-dermis interface at all these distances. The bar lies across the
# finger, because the pad is flatter along the finger (radius 29 mm, compared with 9 mm across). It
# is still curved: the skin at $y$ lies $y^2/58$ mm higher than the apex, so the bar's edge, at
# 1.5 mm, is only 0.96 mm deep. Also, the thickness of the pad differs between receptors, unlike in
# the experiment, in which the bar was moved. The cylinders have curvatures of 16, 8, 4, 2 per inch.
#
# The press takes 50 ms (20 mm/s, assumed). Strain energy density is saved at each step until the
# viscous stress (4 ms) has decayed in the hold; from there on it is constant.
#
#     python demos/neurons/histories.py results/histories
#     python demos/neurons/histories.py results/histories --preset coarse --stimuli bar
#
# It writes `bar.csv`, `cylinder_1.59.csv` ...: a row per step, a column per receptor with its $y$
# in mm as heading. Those in `histories/`, beside this script, come from the first command.

# %%
import csv
from pathlib import Path
from typing import Literal

import numpy as np

from tactile_fem.cli.entry import run
from tactile_fem.runtime.files import atomic_write
from tactile_fem.runtime.logs import set_up
from tactile_fem.scan import scan
from tactile_fem.scan.progress import progress
from tactile_fem.study import (
    Cylinder,
    Finger,
    Grating,
    Hold,
    Output,
    Press,
    Protocol,
    Receptors,
    Solver,
    Study,
)

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

RADII_MM = (1.59, 3.18, 6.35, 12.7)
STIMULI = {
    "bar": Grating(ridge_mm=3.0, count=1, relief_mm=3.0, fillet_radius_mm=0.2, along="x"),
    **{f"cylinder_{radius:g}": Cylinder(radius_mm=radius, along="x") for radius in RADII_MM},
}
HALF_LENGTH_MM, SPACING_MM = 4.0, 0.1
HOLD_S = 0.05


# %%
def main(
    folder: Path,
    *,
    stimuli: tuple[str, ...] = tuple(STIMULI),
    preset: Literal["coarse", "medium", "paper"] = "medium",
    depth: float = 1.0,
    speed: float = 20.0,
    step: float = 0.05,
) -> None:
    """Press each stimulus and save the receptors' SED; lengths in mm, speed in mm/s."""
    rank = MPI.COMM_WORLD.rank
    set_up(rank)
    folder.mkdir(parents=True, exist_ok=True)
    for name in stimuli:
        with progress(rank) as show:
            study = press(STIMULI[name], preset, depth, speed, step)
            trace = scan(study, observers=[show]).trace
        if rank == 0:
            time = trace.time_s - trace.time_s[0]
            keep(folder / f"{name}.csv", time, trace.receptors_mm[:, 1], trace.sed_kPa)
            pressed = trace.sed_kPa[trace.phase == "press"][-1]
            settling = trace.sed_kPa[-1].max() / pressed.max() - 1
            print(
                f"{name}: {trace.force_N[-1, 2]:.4f} N, SED at most {trace.sed_kPa[-1].max():.4f} "
                f"kPa, {100 * settling:+.1f} % in the hold"
            )


def press(stimulus: Grating | Cylinder, preset: str, depth: float, speed: float, step: float):
    """Return a press and a hold over a row of receptors along the finger."""
    places = np.arange(1, round(HALF_LENGTH_MM / SPACING_MM) + 1) * SPACING_MM
    row = tuple((0.0, float(y)) for y in np.round(np.concatenate([-places, places]), 6))
    return Study(
        finger=Finger(preset=preset),
        stimulus=stimulus,
        protocol=Protocol(path=(Press(depth_mm=depth, speed_mm_s=speed), Hold(time_s=HOLD_S))),
        receptors=Receptors(half_width_mm=0.0, extra_mm=row),
        solver=Solver(first_step_mm=step, max_press_step_mm=step),
        output=Output(pictures=False),
    )


def keep(path: Path, time_s: np.ndarray, y_mm: np.ndarray, sed_kPa: np.ndarray) -> None:
    """Write a row per step and a column per receptor, from proximal to distal."""
    order = np.argsort(y_mm)
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["time_s", *(f"{y:g}" for y in y_mm[order])])
        for time, row in zip(time_s, sed_kPa[:, order], strict=True):
            writer.writerow([f"{time:.7g}", *(f"{value:.5g}" for value in row)])


# %%
if __name__ == "__main__":
    run(main)
