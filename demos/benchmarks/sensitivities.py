# %% [markdown]
# # The cost of sensitivities: from the tangent, or from further presses
#
# This benchmark emphasizes
# - what the derivatives along constants of the tissues cost when each step's tangent gives them,
# - what the same derivatives cost as differences of presses with changed constants,
# - how well the two agree.
#
# A flat plate is pressed into the pad, first alone, then with the derivatives, then once for each
# constant with 1 % more of it.
#
#     python demos/benchmarks/sensitivities.py
#     python demos/benchmarks/sensitivities.py --depth 0.2 --pad-size 3 --far-size 6   # small

# %%
import time

import numpy as np

from tactile_fem import Study, run_script
from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import parse_parameter, with_values
from tactile_fem.calibration.press import press
from tactile_fem.study import Finger, Plate, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

NAMES = ("skin", "subcutaneous.C10_MPa", "subcutaneous.C20_MPa", "subcutaneous.D1_per_MPa")
MORE = 0.01


# %%
def main(
    *, depth: float = 1.5, pad_size: float | None = None, far_size: float | None = None
) -> None:
    """Time both and compare the derivatives of the force; lengths in mm."""
    study = Study(
        finger=Finger(pad_size_mm=pad_size, far_size_mm=far_size),
        solver=Solver(first_step_mm=0.25, max_press_step_mm=0.25),
    )
    at = np.array([depth / 2, depth])
    plate = Experiment("plate", Plate(), 0.2, at, np.full(2, np.nan), np.ones(2), np.ones(2))
    parameters = [parse_parameter(name, study) for name in NAMES]
    press(study, plate)  # compiles
    alone, seconds = timed(study, plate, [])
    found, with_tangents = timed(study, plate, [p.change for p in parameters])
    beside = [timed(with_values(study, [p], [MORE]), plate, []) for p in parameters]
    if MPI.COMM_WORLD.rank:
        return
    print(f"press alone {seconds:.1f} s, with {len(NAMES)} derivatives {with_tangents:.1f} s")
    print(f"a derivative from the tangent {(with_tangents - seconds) / len(NAMES):.1f} s")
    print(f"a derivative from a press {np.mean([s for _, s in beside]):.1f} s")
    print("derivative of the force at full depth   tangent N  difference N")
    for k, (name, (other, _)) in enumerate(zip(NAMES, beside, strict=True)):
        difference = (other.values[-1] - alone.values[-1]) / MORE
        print(f"{name:38} {found.derivatives[-1, k]:+10.5f}  {difference:+10.5f}")


def timed(study: Study, experiment: Experiment, changes: list):
    """Return the prediction and the seconds that it took."""
    begun = time.perf_counter()
    prediction = press(study, experiment, changes)
    return prediction, time.perf_counter() - begun


# %%
if __name__ == "__main__":
    run_script(main)
