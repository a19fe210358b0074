# %% [markdown]
# # How stiff and how damped the pad is along the skin
#
# A flat plate to which the skin sticks is pressed to a force P (N), held there while the tissue
# relaxes, and vibrates along the skin. Its force over its displacement is k + i w b. People's pads,
# at 20 to 500 Hz, have k = 1.48 P^0.35 N/mm and b = 1.78 P^0.35 Ns/m (Wiertlewski, Hayward 2012).
# These power laws are predicted: no constant is fitted to them. The model's k contains the mass
# that moves; `--density 0` leaves it out.
#
# What was found to matter has an option:
# - `--viscous-time`, losses that grow with the frequency (Kelvin and Voigt's);
# - `--skin`, how many times as stiff the three layers of the skin are;
# - `--joint`, the bone on its joint in place of the clamp;
# - `--direction`, `--preset`.
#
#     python demos/validation/impedance.py results/impedance  # four minutes on one core
#     python demos/validation/impedance.py results/lossy --viscous-time 0.004
#     python demos/validation/impedance.py results/quick --forces 0.05 --pad-size 3 --far-size 6

# %%
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tactile_fem import Study, completed, run_script, vibrate, write_table
from tactile_fem.study import Finger, Hold, Joint, Plate, Press, Protocol, Receptors, Tissue

FREQUENCIES_HZ = (1.0, 20.0, 50.0, 100.0, 200.0, 500.0)
SKIN = ("stratum_corneum", "epidermis", "dermis")
STUCK_FRICTION = 3.0
PRESS_MM_S, HOLD_S = 2.0, 2.0
LAW_K_N_MM, LAW_B_NS_M, LAW_EXPONENT = 1.48, 1.78, 0.35


@dataclass(frozen=True)
class Row:
    """The model beside the power laws: k in N/mm, b in Ns/m."""

    force_N: float
    frequency_Hz: float
    k: float
    b: float
    law_k: float
    law_b: float


# %%
def main(
    folder: Path,
    *,
    forces: tuple[float, ...] = (0.25, 1.0),
    frequencies: tuple[float, ...] = FREQUENCIES_HZ,
    direction: tuple[float, float, float] = (0.0, 1.0, 0.0),
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    viscous_time: float = 0.0,
    skin: float = 1.0,
    joint: bool = False,
    density: float | None = None,
) -> None:
    """Press, hold, vibrate, and print the model beside the power laws.

    Parameters
    ----------
    folder
        Folder for scans and the table; complete scans are not repeated.
    forces
        Normal forces, N.
    frequencies
        Frequencies in Hz.
    direction
        Direction of the vibration: X across the finger, Y along it.
    preset, pad_size, far_size
        The mesh.
    viscous_time
        Kelvin-Voigt time beside the tissue's relaxation, s.
    skin
        Factor of the moduli of stratum corneum, epidermis and dermis.
    joint
        Whether the bone is on its joint in the vibration.
    density
        Density of all tissues in the vibration, kg/m3, in place of the study's.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    rows: list[Row] = []
    for force in forces:
        study = pressed(finger, force, tissue(viscous_time, skin), Joint() if joint else None)
        results = completed(study, folder / f"{force:g}_N")
        spectrum = vibrate(results.folder, frequencies, direction=direction, density_kg_m3=density)
        along = np.asarray(direction) / np.linalg.norm(direction)
        impedance = spectrum.force_N @ along
        for frequency, value in zip(frequencies, impedance, strict=True):
            b = 1000 * value.imag / (2 * np.pi * frequency)
            scale = force**LAW_EXPONENT
            row = (LAW_K_N_MM * scale, LAW_B_NS_M * scale)
            rows.append(Row(force, frequency, float(value.real), float(b), *row))
    print("P N | f Hz | k N/mm, model, law | b Ns/m, model, law")
    for row in rows:
        print(
            f"{row.force_N:g} | {row.frequency_Hz:g} | {row.k:.2f} {row.law_k:.2f} | "
            f"{row.b:.2f} {row.law_b:.2f}"
        )
    for frequency in frequencies if len(forces) > 1 else ():
        print_exponents(frequency, [row for row in rows if row.frequency_Hz == frequency])
    write_table(folder / "impedance.csv", rows)


def tissue(viscous_time: float, skin: float) -> Tissue:
    """Return tissue that relaxes, with losses that grow with frequency and stiffer skin."""
    base = Tissue(relaxation="fingerpad")
    stiffer = {name: getattr(base, name).scaled(skin) for name in SKIN}
    return Tissue(relaxation="fingerpad", viscous_time_s=viscous_time, **stiffer)


def pressed(finger: Finger, force: float, made: Tissue, joint: Joint | None) -> Study:
    """Return the study of a plate that is pressed to a force and held at it."""
    return Study(
        finger=finger,
        joint=joint,
        tissue=made,
        stimulus=Plate(friction=STUCK_FRICTION),
        protocol=Protocol(
            path=(
                Press(force_N=force, speed_mm_s=PRESS_MM_S),
                Hold(time_s=HOLD_S, output_s=HOLD_S, force_N=force),
            )
        ),
        receptors=Receptors(spacing_mm=5.0),
        output={"pictures": False},
    )


def print_exponents(frequency: float, rows: Sequence[Row]) -> None:
    """Print how k and b grow with the force, as exponents, where both are positive."""
    if all(row.k > 0 and row.b > 0 for row in rows):
        logs = np.log([(row.force_N, row.k, row.b) for row in rows])
        of_k, of_b = (np.polyfit(logs[:, 0], logs[:, n], 1)[0] for n in (1, 2))
        print(f"{frequency:g} Hz: k as P^{of_k:.2f}, b as P^{of_b:.2f}, law P^{LAW_EXPONENT}")


if __name__ == "__main__":
    run_script(main)
