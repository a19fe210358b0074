# %% [markdown]
# # Sensitivity to the tissue constants
#
# This demo emphasizes
# - which constants determine the force and the receptors' strain energy, and which hardly matter,
# - a series of runs that can be interrupted and continued.
#
# Each constant of the tissue set "fitted", and the friction, is multiplied by 0.9 and by 1.1 while
# the others are fixed. $D_1$ is varied on its own: 10 % more of it is about 10 % less bulk modulus.
# The outputs are the flat plate's force at 2.0 mm, the letters' force at 1.97 mm, and the largest
# strain energy density (SED) of any receptor of the line across the finger during the letters'
# press and slide.
#
#     python demos/validation/sensitivity.py results/sensitivity
#     python demos/validation/sensitivity.py results/sensitivity --distance 2

# %%
import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from flat_plate import plate_study

from tactile_fem.cli.entry import run
from tactile_fem.runtime.files import write_table
from tactile_fem.scan import scan
from tactile_fem.study import Polynomial, Protocol, Receptors, Study, Text, Tissue

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

FACTORS = (1.1, 0.9)
OUTCOMES = ("plate_N", "letters_N", "sed_kPa")


@dataclass(frozen=True)
class Run:
    """Results for one set of constants."""

    constant: str
    factor: float
    plate_N: float
    letters_N: float
    sed_kPa: float


# %%
def main(
    folder: Path,
    *,
    tissue: str = "fitted",
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    plate_depth: float = 2.0,
    depth: float = 1.97,
    distance: float = 0.0,
    constants: list[str] | None = None,
) -> None:
    """Vary every constant by 10 %, or only the named `constants`; lengths in mm.

    The runs are saved in the folder; a second start with the same options repeats none.
    """
    path = folder / "sensitivity.csv"
    runs = load(path)
    plate = plate_study(plate_depth, 0.5, {"set": tissue}, preset)
    letters = plate.model_copy(
        update={
            "stimulus": Text(),
            "protocol": Protocol(depth_mm=depth, distance_mm=distance),
            "receptors": Receptors(),
            "solver": Study().solver,
        }
    )
    chosen = constants or [*constants_of(plate.tissue), "friction"]
    for name, factor in [("none", 1.0), *((name, f) for f in FACTORS for name in chosen)]:
        if (name, factor) not in runs:
            runs[name, factor] = measure(plate, letters, name, factor)
            if MPI.COMM_WORLD.rank == 0:
                folder.mkdir(parents=True, exist_ok=True)
                write_table(path, list(runs.values()))
                print(runs[name, factor], flush=True)
    if MPI.COMM_WORLD.rank == 0:
        print_results(runs)


def load(path: Path) -> dict[tuple[str, float], Run]:
    """Return the runs that are complete."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    rows = list(csv.DictReader(lines))
    runs = [Run(row["constant"], *(float(row[n]) for n in ("factor", *OUTCOMES))) for row in rows]
    return {(known.constant, known.factor): known for known in runs}


# %%
def constants_of(tissue: Tissue) -> Iterator[str]:
    """Yield the soft tissues' constants that are not zero, such as "dermis.C10_MPa"."""
    for layer in Tissue.model_fields:
        values = getattr(tissue, layer)
        if isinstance(values, Polynomial):
            yield from (f"{layer}.{key}" for key, value in values.model_dump().items() if value)


def measure(plate: Study, letters: Study, constant: str, factor: float) -> Run:
    """Press plate and letters with one constant multiplied by `factor`."""
    on_plate, on_letters = (scan(varied(s, constant, factor)).trace for s in (plate, letters))
    pressed = on_letters.displacement_mm == 0
    return Run(
        constant,
        factor,
        float(on_plate.force_N[-1, 2]),
        float(on_letters.force_N[pressed][-1, 2]),
        float(np.max(on_letters.sed_kPa)),
    )


def varied(study: Study, constant: str, factor: float) -> Study:
    """Return the study with one constant multiplied by `factor`."""
    if constant == "none":
        return study
    values: dict[str, Any] = study.model_dump()
    section = "stimulus" if constant == "friction" else "tissue"
    *above, key = section, *constant.split(".")
    table = values
    for name in above:
        table = table[name]
    table[key] *= factor
    return Study.model_validate(values)


# %%
def print_results(runs: dict[tuple[str, float], Run]) -> None:
    """Print the changes in percent, for 10 % less and 10 % more of each constant."""
    base = runs["none", 1.0]
    print(f"plate {base.plate_N:.4f} N, letters {base.letters_N:.4f} N, SED {base.sed_kPa:.4f} kPa")
    print(f"{'change in % at -10 %, +10 %':28}" + "".join(f"{name:>18}" for name in OUTCOMES))
    for name in dict.fromkeys(constant for constant, _ in runs if constant != "none"):
        cells = []
        for outcome in OUTCOMES:
            changes = [
                f"{100 * (getattr(runs[name, f], outcome) / getattr(base, outcome) - 1):+8.2f}"
                if (name, f) in runs
                else f"{'-':>8}"
                for f in sorted(FACTORS)
            ]
            cells.append(" ".join(changes))
        print(f"{name:28}" + "".join(f"{cell:>18}" for cell in cells))


# %%
if __name__ == "__main__":
    run(main)
