# %% [markdown]
# # Sensitivity to the tissue constants
#
# This demo emphasizes
# - which constants determine the force and the receptors' strain energy, and which hardly matter,
# - derivatives that come with one scan, from the tangent of each step (`Sensitivities`).
#
# A flat plate is pressed 2.0 mm deep; the letters are pressed 1.97 mm deep and slide. Each constant
# of the soft tissues is changed on its own; 10 % more of $D_1$ is about 10 % less bulk modulus. The
# outputs are the plate's force, the letters' force at the end of the press and the largest strain
# energy density (SED) that a receptor of the line across the finger feels in the slide. The table
# shows ten times the logarithmic derivative: the change in percent for 10 % more of a constant.
#
#     python demos/validation/sensitivity.py results/sensitivity
#     python demos/validation/sensitivity.py results/sensitivity --distance 2

# %%
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from flat_plate import plate_study

from tactile_fem import Simulation, Study, run_script, write_table
from tactile_fem.calibration.sensitivity import Change, Sensitivities
from tactile_fem.study import Finger, Polynomial, Protocol, Tissue

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

Array = np.ndarray


@dataclass(frozen=True)
class Row:
    """Changes in percent for 10 % more of a constant."""

    constant: str
    plate_force: float
    letters_force: float
    slide_sed: float


# %%
def main(
    folder: Path,
    *,
    tissue: str = "fitted",
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    plate_depth: float = 2.0,
    depth: float = 1.97,
    distance: float = 0.2,
) -> None:
    """Print and save the change of the outputs for 10 % more of each constant; lengths in mm."""
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    plate = plate_study(plate_depth, 0.25, {"set": tissue}, preset).model_copy(
        update={"finger": finger}
    )
    letters = Study(
        finger=finger,
        tissue=plate.tissue,
        protocol=Protocol(depth_mm=depth, distance_mm=distance),
    )
    constants = constants_of(plate.tissue)
    changes = [{name: 1.0} for name in constants]
    on_plate, on_letters = (followed(study, changes) for study in (plate, letters))
    columns = [
        on_plate.change(len(on_plate.force) - 1, on_plate.force, on_plate.force_slope),
        on_letters.change(on_letters.pressed, on_letters.force, on_letters.force_slope),
        on_letters.largest_sed_change(),
    ]
    if MPI.COMM_WORLD.rank:
        return
    rows = [
        Row(f"{layer}.{key}", *(round(float(column[i]), 2) for column in columns))
        for i, (layer, key) in enumerate(constants)
    ]
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "sensitivity.csv", rows)
    pressed = on_letters.force[on_letters.pressed]
    largest = on_letters.sed[on_letters.pressed :].max()
    print(f"plate {on_plate.force[-1]:.4f} N, letters {pressed:.4f} N, SED {largest:.4f} kPa")
    print("change in % for 10 % more   plate  letters      SED")
    for row in rows:
        print(
            f"{row.constant:26} {row.plate_force:+7.2f}  {row.letters_force:+7.2f}  "
            f"{row.slide_sed:+7.2f}"
        )


def constants_of(tissue: Tissue) -> list[tuple[str, str]]:
    """Return tissue and name of the soft tissues' constants that are not zero."""
    return [
        (layer, key)
        for layer in Tissue.model_fields
        if isinstance(getattr(tissue, layer), Polynomial)
        for key, value in getattr(tissue, layer)
        if value
    ]


# %%
@dataclass(frozen=True)
class Followed:
    """A scan with its derivatives.

    Attributes
    ----------
    force, sed
        Normal force (steps,), N, and SED of the receptors (steps, receptors), kPa.
    force_slope, sed_slope
        Their derivatives along the constants' logarithms, (steps, constants[, receptors]).
    pressed
        Index of the last step of the press.
    """

    force: Array
    sed: Array
    force_slope: Array
    sed_slope: Array
    pressed: int

    def change(self, step: int, values: Array, slopes: Array) -> Array:
        """Return the changes in percent for 10 % more of each constant."""
        return 10 * slopes[step] / values[step]

    def largest_sed_change(self) -> Array:
        """Return those of the largest SED in the slide."""
        slide = self.sed[self.pressed :]
        step, receptor = np.unravel_index(np.argmax(slide), slide.shape)
        slopes = self.sed_slope[self.pressed + step, :, receptor]
        return 10 * slopes / slide[step, receptor]


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
    value, slope = np.array(values), np.array(slopes)
    pressed = max(k for k, phase in enumerate(phases) if phase == "press")
    return Followed(value[:, 0], value[:, 1:], slope[:, :, 0], slope[:, :, 1:], pressed)


# %%
if __name__ == "__main__":
    run_script(main)
