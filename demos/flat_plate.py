# %% [markdown]
# # A flat plate on the finger pad, against measured fingers
#
# This demo emphasizes
# - another stimulus with the same few lines,
# - the force-displacement curve against published measurements.
#
# Data: four subjects, mean and standard deviation, index finger pad on a flat plate (Gulati and
# Srinivasan's experiments as digitised by Gerling's group). The tissue constants were chosen by
# hand; they were not fitted with this mesh.
#
#     python demos/flat_plate.py flat_plate.png
#     python demos/flat_plate.py flat_plate.png --depth 0.5

# %%
from pathlib import Path

import numpy as np
from cyclopts import run
from matplotlib.figure import Figure

from tactile_fem.scan import scan
from tactile_fem.study import Plate, Protocol, Receptors, Study

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

DEPTH_MM = np.array([0.5, 1.0, 1.5, 2.0])
MEAN_N = np.array([0.037, 0.159, 0.395, 0.769])
DEVIATION_N = np.array([0.010, 0.051, 0.144, 0.229])


# %%
def main(picture: Path, *, depth: float = 2.0, tissue: str = "proposed") -> None:
    """Press a plate and compare the force with measurements."""
    study = Study.model_validate(
        {
            "stimulus": Plate(),
            "tissue": {"set": tissue},
            "protocol": Protocol(depth_mm=depth, distance_mm=0.0),
            "receptors": Receptors(spacing_mm=5.0),
        }
    )
    trace = scan(study).trace
    if MPI.COMM_WORLD.rank:
        return
    force = trace.force_N[:, 2]
    print("depth mm  model N  measured N (sd)")
    for at, mean, deviation in zip(DEPTH_MM, MEAN_N, DEVIATION_N, strict=True):
        if at <= depth + 1e-9:
            model = np.interp(at, trace.depth_mm, force)
            print(f"{at:8.1f}  {model:7.3f}  {mean:.3f} ({deviation:.3f})")
    draw(trace.depth_mm, force, picture)


# %%
def draw(depth_mm: np.ndarray, force_N: np.ndarray, picture: Path) -> None:
    """Draw model and measurements."""
    figure = Figure(figsize=(4.5, 3.5), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(depth_mm, force_N, label="model")
    axes.errorbar(DEPTH_MM, MEAN_N, DEVIATION_N, fmt="o", capsize=3, label="four subjects")
    axes.set(xlabel="Indentation (mm)", ylabel="Normal force (N)")
    axes.legend(frameon=False)
    figure.savefig(picture, dpi=150)


# %%
if __name__ == "__main__":
    run(main)
