# %% [markdown]
# # What receptors feel while gratings and dots slide under the finger
#
# The eight surfaces of `textures.py` are pressed against the finger of the study `macaque`, sliding
# with the force held: 3 mm to come to a steady state, then one period. From there on what is felt
# repeats itself with the surface, so one period is kept, in a small file, from which any duration
# and speed can be made. Ridges are as wide as grooves. Dots are 0.5 mm wide and 0.74 mm high on a
# square lattice, pressed with 0.5 N: so they stand in scripts of the laboratory that recorded the
# rates. The heights of the gratings are not known; 0.5 mm is a variant.
#
#     python demos/validation/texture_histories.py results/textures
#     python demos/validation/texture_histories.py results/quick --conditions 0.74,0.5
#
# Files in `histories/textures` come from a finger with 0.3 times the moduli, the default ones, and
# 0.15 N. It deforms alike, and its forces, energies and stresses were multiplied by 10/3; those of
# 0.5 mm were not: they are of the study itself.
#
# Folders of scans lie in `results/textures/scans`; what is kept, beside them.

# %%
from pathlib import Path
from typing import Any

import numpy as np
from felt_quantities import END_ORGANS, KEEPS_TENSOR, both
from numpy.typing import NDArray
from recordings import SURFACES, Kept
from texture_firing import Condition

from tactile_fem import Results, Study, completed, load_study, run_script
from tactile_fem.runtime.files import atomic_write
from tactile_fem.series import mean_over

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

Array = NDArray[Any]

DOT_RADIUS_MM, FILLET_MM = 0.25, 0.1
RUN_IN_MM, RUN_IN_OUTPUT_MM, OUTPUT_MM = 3.0, 0.2, 0.1
PRESS_MM_S, SPEED_MM_S = 20.0, 80.0
BEYOND_MM = 9.0  # how far a surface reaches beyond the contact point, less than the finger
# Places of afferents: left and right alike, so that lattices of all periods are met evenly.
SA1_MM = tuple((x, y) for x in (0.375, -1.125, 1.875, -2.625) for y in (-1.5, 0.0, 1.5))
PC_MM = tuple((x, y) for x in (0.375, -1.125) for y in (-1.0, 0.0, 1.0))
PC_BELOW_MM = 1.1  # 2 mm in people


# %%
CONDITIONS = tuple(Condition(*pair) for pair in ((0.74, 0.5), (0.5, 0.5)))


def stimulus(surface: str, height_mm: float, slide_mm: float) -> dict[str, Any]:
    """Return a surface that reaches beyond the finger on all of its way."""
    kind, period = surface.split("_")[0], SURFACES[surface]
    before = np.ceil(BEYOND_MM / period)
    rows = int(before + np.ceil((slide_mm + BEYOND_MM) / period)) + 1
    common = {
        "kind": kind,
        "relief_mm": height_mm,
        "fillet_radius_mm": min(FILLET_MM, height_mm),
        "start_mm": before * period,
    }
    if kind == "grating":
        return common | {"ridge_mm": period / 2, "groove_mm": period / 2, "count": rows}
    columns = 2 * int(np.ceil(BEYOND_MM / 1.5 / period)) + 1
    lattice = {"spacing_mm": period, "rows": rows, "columns": columns}
    return common | lattice | {"radius_mm": DOT_RADIUS_MM}


def study(
    surface: str, condition: Condition, base: Study, *, output_mm: float = OUTPUT_MM
) -> Study:
    """Return the study of a surface; `output_mm` is that of the period that is kept."""
    held = {"force_N": condition.force_N, "speed_mm_s": SPEED_MM_S}
    slides = [
        {"kind": "slide", "by_mm": (0.0, -by), "output_mm": out} | held
        for by, out in ((RUN_IN_MM, RUN_IN_OUTPUT_MM), (SURFACES[surface], output_mm))
    ]
    press = {"kind": "press", "force_N": condition.force_N, "speed_mm_s": PRESS_MM_S}

    def population(name: str, kind: str, at: Any, **more: Any) -> dict[str, Any]:
        receptors = more.pop("receptors", {}) | {"half_width_mm": 0.0, "extra_mm": at}
        return {"name": name, "kind": kind, "receptors": receptors} | more

    end_organs, deep = {"end_organs": END_ORGANS}, {"below_skin_mm": PC_BELOW_MM}
    return Study.model_validate(
        {
            "finger": base.finger,
            "tissue": base.tissue,
            "receptors": base.receptors,
            "stimulus": stimulus(surface, condition.height_mm, RUN_IN_MM + SURFACES[surface]),
            "protocol": {"path": [press, *slides]},
            "afferents": [
                population("SA1", "SA1", SA1_MM, feels=KEEPS_TENSOR),
                population("cluster", "SA1", SA1_MM, feels=KEEPS_TENSOR, receptors=end_organs),
                population("RA", "RA", SA1_MM),
                population("PC", "PC", PC_MM, receptors=deep),
            ],
            "output": {"pictures": False, "states_mm": 100.0},
        }
    )


# %%
def felt(results: Results, period_mm: float) -> dict[str, Array]:
    """Return what is felt in the last period, both ends included: (rows, receptors)."""
    trace = results.trace
    # The line of each population begins with the apex, which is not among the places.
    column = {
        name: np.flatnonzero(trace["population"] == name)[1:]
        for name in ("SA1", "cluster", "RA", "PC")
    }
    at = trace["displacement_mm"]
    rows = np.flatnonzero(at > at[-1] - period_mm - 1e-6)
    needed = "sed_kPa", "stretches", "stresses_kPa", "right_cauchy_green", "moved_mm"
    last = {name: trace[name][rows] for name in needed}
    return {
        "slide_mm": at[rows] - at[-1] + period_mm,
        "force_N": trace["force_N"][rows, 2],
        **both(last, column["SA1"], column["cluster"]),
        "shortening": 1 - last["stretches"][:, column["RA"], 0],
        "moved_mm": last["moved_mm"][:, column["PC"], 2],
    }


def add(path: Path, surface: str, arrays: dict[str, Array]) -> None:
    """Add a surface to a file, in single precision; all but movements with fewer digits."""
    kept = dict(Kept.of(path).arrays)
    for key, values in arrays.items():
        shorter = values if key == "moved_mm" else rounded(values)
        kept[f"{surface}.{key}"] = shorter.astype(np.float32)
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **kept)


def rounded(values: Array) -> Array:
    """Return values to 11 bits, which are compressed well."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.round(mantissa * 2**11) / 2**11, exponent)


# %%
def main(
    folder: Path,
    *,
    surfaces: tuple[str, ...] = tuple(SURFACES),
    conditions: tuple[str, ...] = (),
    pad_size: float | None = None,
    output: float = OUTPUT_MM,
) -> None:
    """Slide surfaces and keep what is felt; what exists is not computed again.

    Parameters
    ----------
    folder
        Folder for scans and files.
    surfaces
        Names, such as grating_12 and dots_3.
    conditions
        Heights in mm and forces in N, such as 0.74,0.5.
    pad_size
        Edge of the elements under the contact, mm, instead of the study's own.
    output
        Distance between outputs, mm.
    """
    base = load_study("macaque", [f"finger.pad_size_mm={pad_size}"] if pad_size else [])
    for condition in [Condition.parsed(text) for text in conditions] or CONDITIONS:
        path = folder / f"{condition}.npz"
        for surface in surfaces:
            if surface in Kept.of(path).surfaces:
                continue
            one = study(surface, condition, base, output_mm=output)
            results = completed(one, folder / "scans" / f"{path.stem}_{surface}")
            if MPI.COMM_WORLD.rank == 0:
                arrays = felt(results, SURFACES[surface])
                add(path, surface, arrays)
                print(f"{path.stem}, {surface}: {summary(arrays)}", flush=True)


def summary(arrays: dict[str, Array]) -> str:
    """Return mean force and strain energy density in a period, and their ranges."""
    names = ("force", "force_N", "N"), ("SED", "sed_kPa", "kPa")
    means = {key: mean_over(arrays["slide_mm"], arrays[key]).mean() for _, key, _ in names}
    return ", ".join(
        f"{name} {means[key]:.4g} {unit} ({arrays[key].min():.3g} to {arrays[key].max():.3g})"
        for name, key, unit in names
    )


# %%
if __name__ == "__main__":
    run_script(main)
