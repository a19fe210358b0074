# %% [markdown]
# # The study `macaque` beside what is published of monkeys' fingers
#
# The skin's profile under a cylinder of 3.17 mm across the finger, 1 mm deep (Srinivasan 1989), to
# which the default finger is fitted and this one is not. No force on a monkey's finger at a depth
# was found, so its stiffness is not checked: the depths are told to which forces press it.
#
#     python demos/validation/macaque.py results/macaque

# %%
from dataclasses import replace
from pathlib import Path

import numpy as np
from recordings import measured

from tactile_fem import Study, load_study, read_measurements, run_script, scan, write_table
from tactile_fem.calibration.press import press
from tactile_fem.neuron import r_squared
from tactile_fem.study import Plate, Press, Protocol, Receptors, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

CYLINDER = Path(__file__).parent / "measured" / "cylinder.csv"
FARTHEST_MM = 5.0  # places farther from the axis lie beyond the tip


def main(folder: Path, *, pad_size: float | None = None, step: float = 0.1) -> None:
    """Press cylinder and plate, and print the table; lengths in mm.

    Parameters
    ----------
    folder
        Folder for the table.
    pad_size
        Edge of the elements under the contact, instead of the study's own.
    step
        Longest step of a press.
    """
    folder.mkdir(parents=True, exist_ok=True)
    base = load_study("macaque", [f"finger.pad_size_mm={pad_size}"] if pad_size else [])
    study = base.model_copy(update={"solver": Solver(max_press_step_mm=step)})
    (whole,) = read_measurements([CYLINDER])
    near = whole.place_mm <= FARTHEST_MM
    names = "depth_mm", "place_mm", "mean", "sd"
    profile = replace(whole, **{name: getattr(whole, name)[near] for name in names})
    found = press(study, profile).values
    forces = np.unique(measured("spheres")["force_N"])
    path = tuple(Press(force_N=float(force), speed_mm_s=0.5) for force in (*forces, 0.5))
    plate = Study(
        finger=study.finger,
        tissue=study.tissue,
        stimulus=Plate(),
        protocol=Protocol(path=path),
        receptors=Receptors(half_width_mm=0.0),
        solver=study.solver,
    )
    trace = scan(plate).trace
    if MPI.COMM_WORLD.rank:
        return
    print(f"profile: R² {r_squared(found, profile.mean):.3f}")
    rows = [
        {"place_mm": float(place), "measured_mm": float(mean), "model_mm": float(model)}
        for place, mean, model in zip(profile.place_mm, profile.mean, found, strict=True)
    ]
    write_table(folder / "profile.csv", rows)
    for force in (*forces, 0.5):
        depth = np.interp(force, trace.force_N[:, 2], trace.depth_mm)
        area = np.interp(force, trace.force_N[:, 2], trace.contact_area_mm2)
        print(f"plate, {force:g} N: {depth:.2f} mm, {area:.0f} mm²")


# %%
if __name__ == "__main__":
    run_script(main)
