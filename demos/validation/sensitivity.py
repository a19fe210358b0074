# %% [markdown]
# # Sensitivity to the tissue constants
#
# Which constants determine forces and the receptors' strain energy density (SED). A flat plate is
# pressed 2.0 mm deep; the letters are pressed 1.97 mm deep and slide. Derivatives come with each
# scan, from the tangent of its steps (`Sensitivities`). The table shows the change in percent for
# 10 % more of a constant: of the plate's force, of the letters' force at the end of the press, and
# of the largest SED that a receptor feels in the slide.
#
#     python demos/validation/sensitivity.py results/sensitivity --distance 2

# %%
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_fem import Simulation, Study, run_script, write_table
from tactile_fem.calibration.sensitivity import Change, Sensitivities
from tactile_fem.study import Finger, Plate, Polynomial, Protocol, Receptors, Solver, Tissue

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

Array = np.ndarray


@dataclass(frozen=True)
class Followed:
    """A scan with its derivatives along the constants' logarithms.

    Values are (steps, 1 + receptors): normal force, N, and SED, kPa; slopes are (steps, constants,
    1 + receptors). `pressed` is the last step of the press.
    """

    values: Array
    slopes: Array
    pressed: int

    def change(self, step: int, column: int) -> Array:
        """Return the changes in percent for 10 % more of each constant."""
        return 10 * self.slopes[step, :, column] / self.values[step, column]


# %%
def main(
    folder: Path,
    *,
    pad_size: float | None = None,
    far_size: float | None = None,
    plate_depth: float = 2.0,
    depth: float = 1.97,
    distance: float = 0.2,
) -> None:
    """Print and save the change of the results for 10 % more of each constant; lengths in mm."""
    finger = Finger(pad_size_mm=pad_size, far_size_mm=far_size)
    plate = Study(
        finger=finger,
        stimulus=Plate(),
        protocol=Protocol(depth_mm=plate_depth, distance_mm=0.0, press_speed_mm_s=0.2),
        receptors=Receptors(spacing_mm=5.0),
        solver=Solver(first_step_mm=0.25, max_press_step_mm=0.25),
    )
    letters = Study(finger=finger, protocol=Protocol(depth_mm=depth, distance_mm=distance))
    constants = constants_of(plate.tissue)
    changes = [{name: 1.0} for name in constants]
    on_plate, on_letters = (followed(study, changes) for study in (plate, letters))
    slide = on_letters.values[on_letters.pressed :, 1:]
    step, receptor = np.unravel_index(np.argmax(slide), slide.shape)
    columns = {
        "plate_force": on_plate.change(-1, 0),
        "letters_force": on_letters.change(on_letters.pressed, 0),
        "slide_sed": on_letters.change(on_letters.pressed + step, receptor + 1),
    }
    if MPI.COMM_WORLD.rank:
        return
    pressed = on_letters.values[on_letters.pressed, 0]
    plate_N, largest = on_plate.values[-1, 0], slide.max()
    print(f"plate {plate_N:.4f} N, letters {pressed:.4f} N, SED {largest:.4f} kPa")
    print("change in % for 10 % more   plate  letters      SED")
    rows = []
    for (layer, key), *numbers in zip(constants, *columns.values(), strict=True):
        print(f"{layer + '.' + key:26}" + "".join(f" {number:+8.2f}" for number in numbers))
        rows.append({"constant": f"{layer}.{key}", **dict(zip(columns, numbers, strict=True))})
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "sensitivity.csv", rows)


def constants_of(tissue: Tissue) -> list[tuple[str, str]]:
    """Return tissue and name of the soft tissues' constants that are not zero."""
    return [
        (layer, key)
        for layer in Tissue.model_fields
        if isinstance(getattr(tissue, layer), Polynomial)
        for key, value in getattr(tissue, layer)
        if value and key.endswith("MPa")
    ]


def followed(study: Study, changes: list[Change]) -> Followed:
    """Run a study and follow its derivatives."""
    values, slopes, phases = [], [], []
    with closing(Simulation(study)) as simulation:
        sensitivities = Sensitivities(simulation.problem, changes)

        def read() -> Array:
            return np.append(simulation.load().force_N[2], simulation.receptors.read().sed_kPa)

        for step in simulation.steps():
            sensitivities.follow()
            values.append(read())
            slopes.append(sensitivities.derivative(read))
            phases.append(step.phase)
    pressed = max(k for k, phase in enumerate(phases) if phase == "press")
    return Followed(np.array(values), np.array(slopes), pressed)


# %%
if __name__ == "__main__":
    run_script(main)
