# %% [markdown]
# # Where contact begins, and the probe's edge
#
# This demo emphasizes
# - how much of a misfit a wrong zero of the depth explains (it is known to about 0.1 mm),
# - whether the radius of the probe's edge matters.
#
# Plate and probe are pressed with the default finger to the measured depths and 0.1 mm beyond and
# before. Between these, forces are interpolated, so the model's force at the depth $d + \delta$ is
# known for every $\delta$ up to 0.1 mm. $\delta$ is found that minimizes the squared deviations of
# both indenters together, and of each alone. The probe is pressed once more with another edge.
#
#     python demos/validation/onset.py results/onset

# %%
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

from tactile_fem import Study, run_script, write_table
from tactile_fem.calibration.measurements import Experiment, read_measurements
from tactile_fem.calibration.press import press
from tactile_fem.study import Finger, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

MEASURED = Path(__file__).parent / "measured"
SHIFT_MM = 0.1
EDGE_MM = 0.4


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    deepest: float = 3.0,
) -> None:
    """Print the deviations with the best shift of the depth, and with another edge; mm."""
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    study = Study(finger=finger, solver=Solver(first_step_mm=0.1, max_press_step_mm=0.25))
    measured = [
        up_to(experiment, deepest)
        for experiment in read_measurements([MEASURED / "plate.csv", MEASURED / "probe.csv"])
    ]
    curves = [curve(study, experiment) for experiment in measured]
    probe = measured[1]
    edge_mm = {"fillet_radius_mm": EDGE_MM}
    rounder = replace(probe, indenter=probe.indenter.model_copy(update=edge_mm))
    edge = press(study, rounder).values / press(study, probe).values - 1
    if MPI.COMM_WORLD.rank:
        return
    rows = [
        told(name, experiment, force, shift)
        for name, chosen in (("both", [0, 1]), ("plate", [0]), ("probe", [1]))
        for shift in (0.0, best_shift([measured[k] for k in chosen], [curves[k] for k in chosen]))
        for experiment, force in zip(measured, curves, strict=True)
        if len(chosen) == 2 or experiment is measured[chosen[0]]
    ]
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "onset.csv", rows)
    for row in rows:
        print(" ".join(f"{name} {value}" for name, value in row.items()))
    changes = ", ".join(f"{100 * change:+.1f}" for change in edge)
    print(f"probe's edge of {EDGE_MM} instead of {probe.indenter.fillet_radius_mm} mm: {changes} %")


def up_to(experiment: Experiment, deepest_mm: float) -> Experiment:
    """Return the part of an experiment up to a depth."""
    keep = experiment.depth_mm <= deepest_mm
    names = ("depth_mm", "place_mm", "mean", "sd")
    return replace(experiment, **{name: getattr(experiment, name)[keep] for name in names})


def curve(study: Study, experiment: Experiment) -> PchipInterpolator:
    """Return the model's force over depth, around the measured depths."""
    beside = np.concatenate([experiment.depth_mm + shift for shift in (-SHIFT_MM, 0, SHIFT_MM)])
    depth = np.unique(np.round(beside, 6))
    nothing = np.full(len(depth), np.nan)
    wanted = replace(experiment, depth_mm=depth, place_mm=nothing, mean=nothing, sd=nothing)
    forces = press(study, wanted).values
    return PchipInterpolator(np.append(0.0, depth), np.append(0.0, forces))


def deviations(experiment: Experiment, force: PchipInterpolator, shift_mm: float) -> np.ndarray:
    """Return model less measurement in standard deviations, with contact `shift_mm` earlier."""
    return (force(experiment.depth_mm + shift_mm) - experiment.mean) / experiment.sd


def best_shift(experiments: list[Experiment], forces: list[PchipInterpolator]) -> float:
    """Return the shift of the depth with the least sum of squares."""

    def squares(shift: float) -> float:
        found = [deviations(e, f, shift) for e, f in zip(experiments, forces, strict=True)]
        return float(np.sum(np.concatenate(found) ** 2))

    return float(minimize_scalar(squares, bounds=(-SHIFT_MM, SHIFT_MM), method="bounded").x)


def told(name: str, experiment: Experiment, force: PchipInterpolator, shift: float) -> dict:
    """Return a row: the shift, what it was chosen for, the deviations."""
    off = deviations(experiment, force, shift)
    return {
        "chosen for": name,
        "indenter": experiment.indenter.kind,
        "shift_mm": round(shift, 3),
        "deviations_sd": " ".join(f"{value:+.2f}" for value in off),
        "sum_of_squares": round(float(off @ off), 2),
    }


# %%
if __name__ == "__main__":
    run_script(main)
