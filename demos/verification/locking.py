# %% [markdown]
# # Does nearly incompressible fat lock?
#
# This demo emphasizes
# - how the plate's force depends on the mesh for fat of the fitted compressibility,
# - the same for fat that is ten times as compressible, which cannot lock.
#
# Elements that lock are too stiff by a factor that falls with their size and rises with $K/G$. So
# if the force on the coarse mesh lay further above that on the finer ones for the fitted fat than
# for the compressible one, the fat would lock. Quadratic tetrahedra with displacements alone are
# known to lock little (no more than the order of convergence suffers); this measures it.
#
#     python demos/verification/locking.py results/locking
#     python demos/verification/locking.py results/locking --presets coarse --presets medium

# %%
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import parse_parameter, with_values
from tactile_fem.calibration.press import press
from tactile_fem.cli.entry import run
from tactile_fem.finger import load_finger
from tactile_fem.runtime.files import write_table
from tactile_fem.study import Finger, Plate, Solver, Study
from tactile_fem.tissue.energies import bulk_modulus, shear_modulus

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

SOFTER = 10.0  # in bulk


@dataclass(frozen=True)
class Row:
    """Force of one press."""

    mesh: str
    tetrahedra: int
    bulk_over_shear: float
    force_N: float


# %%
def main(
    folder: Path,
    *,
    depth: float = 1.5,
    presets: tuple[str, ...] = ("coarse", "medium", "paper"),
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Press a plate on each mesh with both kinds of fat; lengths in mm."""
    rows = []
    for preset in presets:
        finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
        study = Study(finger=finger, solver=Solver(first_step_mm=0.1, max_press_step_mm=0.25))
        bulk = parse_parameter("subcutaneous.D1_per_MPa", study)
        for fat in (study, with_values(study, [bulk], [np.log(SOFTER)])):
            rows.append(pressed(preset, fat, depth))
            if MPI.COMM_WORLD.rank == 0:
                print(rows[-1], flush=True)
    if MPI.COMM_WORLD.rank:
        return
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "locking.csv", rows)
    print_results(rows)


def pressed(name: str, study: Study, depth: float) -> Row:
    """Press the plate."""
    nothing = np.array([np.nan])
    plate = Experiment("plate", Plate(), 0.2, np.array([depth]), nothing, nothing, nothing)
    fat = study.tissue.subcutaneous
    return Row(
        name,
        len(load_finger(study.finger).tets),
        round(bulk_modulus(fat) / shear_modulus(fat), 1),
        float(press(study, plate).values[0]),
    )


# %%
def print_results(rows: list[Row]) -> None:
    """Print each mesh's force against that of the finest mesh."""
    print("mesh      tetrahedra    K/G   force N  to the finest")
    for row in rows:
        finest = [other for other in rows if other.bulk_over_shear == row.bulk_over_shear][-1]
        print(
            f"{row.mesh:8} {row.tetrahedra:11d} {row.bulk_over_shear:6.1f}  {row.force_N:8.4f}"
            f"  {row.force_N / finest.force_N - 1:+8.2%}"
        )


# %%
if __name__ == "__main__":
    run(main)
