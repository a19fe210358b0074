# %% [markdown]
# # Does nearly incompressible fat lock?
#
# Elements that lock are too stiff by a factor that grows with their size and with $K/G$. A plate is
# pressed into the default finger, whose fat's change of volume beyond $K/G = 25$ counts at the
# elements' centres alone (`solver.locking_ratio`); into the same with a change of volume that
# counts at every quadrature point; and into one with fat that is ten times as compressible.
#
#     python demos/verification/locking.py results/locking --presets coarse --presets medium

# %%
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_fem import Experiment, Study, run_script, write_table
from tactile_fem.calibration.parameters import parse_parameter, with_values
from tactile_fem.calibration.press import press
from tactile_fem.study import Finger, Plate, Solver
from tactile_fem.tissue.energies import bulk_modulus, shear_modulus

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

SOFTER = 10.0  # in bulk
EVERY_POINT = 1e9


@dataclass(frozen=True)
class Row:
    """Force of one press."""

    mesh: str
    tetrahedra: int
    bulk_over_shear: float
    locking_ratio: float
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
    """Press a plate on each mesh in the three ways; lengths in mm."""
    rows = []
    for preset in presets:
        finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
        study = Study(finger=finger, solver=Solver(first_step_mm=0.1, max_press_step_mm=0.25))
        bulk = parse_parameter("subcutaneous.D1_per_MPa", study)
        whole = study.solver.model_copy(update={"locking_ratio": EVERY_POINT})
        for way in (
            study,
            study.model_copy(update={"solver": whole}),
            with_values(study, [bulk], [np.log(SOFTER)]),
        ):
            rows.append(pressed(preset, way, depth))
            if MPI.COMM_WORLD.rank == 0:
                print(rows[-1], flush=True)
    if MPI.COMM_WORLD.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
        write_table(folder / "locking.csv", rows)


def pressed(name: str, study: Study, depth: float) -> Row:
    """Press the plate."""
    nothing = np.array([np.nan])
    fat = study.tissue.subcutaneous
    plate = Experiment("plate", Plate(), 0.2, np.array([depth]), nothing, nothing, nothing)
    return Row(
        name,
        len(study.finger.mesh().cells),
        round(float(bulk_modulus(fat) / shear_modulus(fat)), 1),
        study.solver.locking_ratio,
        float(press(study, plate).values[0]),
    )


# %%
if __name__ == "__main__":
    run_script(main)
