# %% [markdown]
# # A flat plate on the finger pad, compared with measured fingers
#
# This demo emphasizes
# - force and contact area over depth, compared with published measurements,
# - the volume change of the pad,
# - how to use another stimulus.
#
# Forces: four subjects, mean and standard deviation, index finger pad on a flat plate (Gulati and
# Srinivasan's experiments as digitised by Gerling's group). The tissue set "fitted" was fitted to
# them (`fit_tissue.py`), so for this set they show the quality of the fit. Contact areas and volume
# were not used. The accepted ranges of the area are wide, because fingers differ: 40 to 70 mm² at
# 0.25 N, 60 to 90 at 0.5 N, 90 to 130 at 1 N. A finger's volume decreases by at most 5 %.
#
# The plate rises at 0.2 mm/s. At this speed the viscosity, which stabilizes the solver, adds about
# 0.2 % to the force.
#
#     python demos/validation/flat_plate.py results/plate
#     python demos/validation/flat_plate.py results/plate --tissue proposed
#     python demos/validation/flat_plate.py results/plate --depth 0.5

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from tactile_fem import Study, run_script, scan, write_table
from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.simulation.trace import Trace
from tactile_fem.study import Finger, Plate, Protocol, Receptors, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

(MEASURED,) = read_measurements([Path(__file__).parent / "measured" / "plate.csv"])
# Force N: least and largest contact area, mm².
AREA_GATES = {0.25: (40.0, 70.0), 0.5: (60.0, 90.0), 1.0: (90.0, 130.0)}
LARGEST_LOSS = 0.05
BLUE, ORANGE = "#0072B2", "#D55E00"


@dataclass(frozen=True)
class State:
    """State of the finger at one indentation depth."""

    depth_mm: float
    force_N: float
    contact_area_mm2: float
    volume_change: float


# %%
def main(
    folder: Path,
    *,
    depth: float = 2.5,
    step: float = 0.125,
    tissue: str = "fitted",
    preset: Literal["coarse", "medium", "paper"] = "coarse",
) -> None:
    """Press a plate and compare force, area and volume with measurements; lengths in mm."""
    trace = scan(plate_study(depth, step, {"set": tissue}, preset)).trace
    if MPI.COMM_WORLD.rank:
        return
    folder.mkdir(parents=True, exist_ok=True)
    columns = (trace.depth_mm, trace.force_N[:, 2], trace.contact_area_mm2, trace.volume_change)
    states = [State(*row) for row in np.column_stack(columns).tolist()]
    write_table(folder / "flat_plate.csv", states)
    print_results(trace)
    draw(trace, folder / "flat_plate.png")


def plate_study(depth: float, step: float, tissue: dict[str, Any], preset: str) -> Study:
    """Return a slow press of a flat plate in equal steps; lengths in mm."""
    return Study.model_validate(
        {
            "finger": Finger(preset=preset),
            "stimulus": Plate(),
            "tissue": tissue,
            "protocol": Protocol(depth_mm=depth, distance_mm=0.0, press_speed_mm_s=0.2),
            "receptors": Receptors(spacing_mm=5.0),
            "solver": Solver(first_step_mm=step, max_press_step_mm=step),
        }
    )


# %%
def print_results(trace: Trace) -> None:
    """Print force, area and volume next to the measurements, up to the depth reached."""
    depth, force = trace.depth_mm, trace.force_N[:, 2]
    print("depth mm  model N  measured N (sd)  error/sd")
    for at, mean, deviation in zip(MEASURED.depth_mm, MEASURED.mean, MEASURED.sd, strict=True):
        if at <= depth[-1] + 1e-9:
            model = np.interp(at, depth, force)
            error = (model - mean) / deviation
            print(f"{at:8.1f}  {model:7.4f}  {mean:.3f} ({deviation:.3f})  {error:+8.2f}")
    print("force N  area mm²  gate mm²")
    for at, (least, largest) in AREA_GATES.items():
        if at <= force[-1]:
            area = np.interp(at, force, trace.contact_area_mm2)
            print(f"{at:7.2f}  {area:8.1f}  {least:.0f} to {largest:.0f}")
    loss = -100 * trace.volume_change
    print(f"volume lost at {depth[-1]:.2f} mm: {loss[-1]:.2f} %, at most {loss.max():.2f} %")


# %%
def draw(trace: Trace, picture: Path) -> None:
    """Draw force over depth, and area over force with the volume lost."""
    figure = Figure(figsize=(10, 3.3), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    depth, force = trace.depth_mm, trace.force_N[:, 2]
    left.plot(depth, force, color=BLUE, label="model")
    measured = {"fmt": "o", "capsize": 3, "color": ORANGE, "label": "four subjects, mean ± sd"}
    left.errorbar(MEASURED.depth_mm, MEASURED.mean, MEASURED.sd, **measured)
    left.set(xlabel="Indentation (mm)", ylabel="Normal force (N)")
    middle.plot(force, trace.contact_area_mm2, color=BLUE, label="model")
    at, gates = np.array(list(AREA_GATES)), np.array(list(AREA_GATES.values()))
    centre = gates.mean(axis=1)
    span = {"fmt": "none", "capsize": 5, "elinewidth": 2, "color": ORANGE, "label": "gates"}
    middle.errorbar(at, centre, centre - gates[:, 0], **span)
    middle.set(xlabel="Normal force (N)", ylabel="Contact area (mm²)")
    right.plot(depth, -100 * trace.volume_change, color=BLUE, label="model")
    right.axhline(100 * LARGEST_LOSS, color=ORANGE, linestyle="--", label="largest measured")
    right.set(xlabel="Indentation (mm)", ylabel="Volume lost (%)")
    for axes in (left, middle, right):
        axes.set_ylim(bottom=0)
        axes.legend(frameon=False, loc="best")
    figure.savefig(picture, dpi=150)


# %%
if __name__ == "__main__":
    run_script(main)
