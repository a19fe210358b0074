# %% [markdown]
# # What receptors feel while gratings and dots slide under the finger
#
# The eight surfaces of `textures.py` are pressed to a force and slide at the depth reached: 5 mm to
# come to a steady state, then one period. From there on all that is felt repeats itself with the
# surface, so one period is kept, in a small file, from which any duration and speed can be made.
# Ridges are as wide as grooves, dots are 1 mm wide on a square lattice.
#
#     python demos/validation/texture_histories.py results/textures
#     python demos/validation/texture_histories.py results/quick --conditions 0.5,0.3
#
# Folders of scans lie in `results/textures/scans`; what is kept, beside them.

# %%
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from texture_firing import APART_MM, SURFACES, Condition, Kept

from tactile_fem import Results, Study, completed, run_script
from tactile_fem.runtime.files import atomic_write
from tactile_fem.series import mean_over

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

Array = NDArray[Any]

DOT_RADIUS_MM, FILLET_MM = 0.5, 0.2
RUN_IN_MM, RUN_IN_OUTPUT_MM, OUTPUT_MM = 5.0, 0.2, 0.1
PRESS_MM_S, SPEED_MM_S = 20.0, 80.0
BEYOND_MM = 14.0  # how far a surface reaches beyond the contact point, less than the finger
# Places of afferents: left and right alike, so that lattices of all periods are met evenly.
SOLID_MM = tuple(
    (x, y) for x in (0.375, -1.125, 1.875, -2.625) for y in (-3.0, -1.5, 0.0, 1.5, 3.0)
)
SECTION_MM = tuple((0.0, 0.5 * k) for k in range(-6, 7))
DEEP_MM = tuple((x, y) for x in (0.375, -1.875) for y in (-2.0, 0.0, 2.0))
# Points around each place at which nothing is averaged: a cluster of end organs, and points 0.5 mm
# apart, of which the difference is felt.
CLUSTER_MM = 0.125


# %%
CONDITIONS = tuple(
    Condition(*pair) for pair in ((0.5, 0.3), (0.2, 0.1), (0.2, 0.5), (1.0, 0.1), (1.0, 0.5))
)


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


def around(places: tuple[tuple[float, float], ...], section: bool) -> Iterator[tuple[float, float]]:
    """Yield for each place itself, the points of its cluster and those that are apart."""
    steps = [(0.0, 1.0)] if section else [(1.0, 0.0), (0.0, 1.0)]
    for x, y in places:
        yield x, y
        for reach in (CLUSTER_MM, APART_MM / 2):
            for i, j in steps:
                yield from ((x + sign * reach * i, y + sign * reach * j) for sign in (-1, 1))


def study(
    surface: str,
    condition: Condition,
    *,
    preset: str = "medium",
    kind: Literal["solid", "section"] = "solid",
    speed_mm_s: float = SPEED_MM_S,
    inertia: bool = False,
    output_mm: float = OUTPUT_MM,
    periods: int = 1,
) -> Study:
    """Return the study of a surface; `output_mm` is that of the periods."""
    section = kind == "section"
    places, deep = (SECTION_MM, SECTION_MM[2:-2:2]) if section else (SOLID_MM, DEEP_MM)
    way = periods * SURFACES[surface]
    slides = [
        {"kind": "slide", "by_mm": (0.0, -by), "output_mm": out, "speed_mm_s": speed_mm_s}
        for by, out in ((RUN_IN_MM, RUN_IN_OUTPUT_MM), (way, output_mm))
    ]
    press = {"kind": "press", "force_N": condition.force_N, "speed_mm_s": PRESS_MM_S}

    def population(name: str, kind: str, at: Any, **more: Any) -> dict[str, Any]:
        receptors = {"placement": "line", "half_width_mm": 0.0, "half_length_mm": 0.0}
        return {"name": name, "kind": kind, "receptors": receptors | {"extra_mm": at} | more}

    return Study.model_validate(
        {
            "finger": {"preset": preset, "kind": kind},
            "stimulus": stimulus(surface, condition.height_mm, RUN_IN_MM + way),
            "protocol": {"path": [press, *slides]},
            "afferents": [
                population("SA1", "SA1", places),
                population("points", "SA1", tuple(around(places, section)), average_radius_mm=0.0),
                population("RA", "RA", places),
                population("PC", "PC", deep),
            ],
            "solver": {"inertia": inertia},
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
        for name in ("SA1", "points", "RA", "PC")
    }
    ball = column["SA1"]
    points = column["points"].reshape(len(ball), -1)
    in_cluster = (points.shape[1] + 1) // 2
    cluster, pairs = points[:, :in_cluster], points[:, in_cluster:].reshape(len(ball), -1, 2)
    at = trace["displacement_mm"]
    rows = np.flatnonzero(at > at[-1] - period_mm - 1e-6)
    stresses, stretches = trace["stresses_kPa"][rows], trace["stretches"][rows]
    von_mises, sed = trace["von_mises_kPa"][rows], trace["sed_kPa"][rows]

    def difference(values: Array) -> Array:
        low, high = np.moveaxis(values[:, pairs], -1, 0)
        return np.linalg.norm(high - low, axis=-1)

    return {
        "slide_mm": at[rows] - at[-1] + period_mm,
        "force_N": trace["force_N"][rows, 2],
        "sed_kPa": sed[:, ball],
        "von_mises_kPa": von_mises[:, ball],
        "stretch": stretches[:, ball, -1] - 1,
        "compression_kPa": -stresses[:, ball, 0],
        "stretch_difference": difference(stretches[..., -1]),
        "sed_difference_kPa": difference(sed),
        "cluster_sed_kPa": sed[:, cluster].max(axis=-1),
        "cluster_von_mises_kPa": von_mises[:, cluster].max(axis=-1),
        "cluster_compression_kPa": -stresses[:, cluster, 0].min(axis=-1),
        "shortening": 1 - stretches[:, column["RA"], 0],
        "moved_mm": trace["moved_mm"][rows][:, column["PC"], 2],
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
    preset: Literal["coarse", "medium", "paper"] = "medium",
    kind: Literal["solid", "section"] = "solid",
    speed: float = SPEED_MM_S,
    inertia: bool = False,
    output: float = OUTPUT_MM,
    periods: int = 1,
) -> None:
    """Slide surfaces and keep what is felt; what exists is not computed again.

    Parameters
    ----------
    folder
        Folder for scans and files.
    surfaces
        Names, such as grating_12 and dots_3.
    conditions
        Heights in mm and forces in N (of a section N/mm), such as 0.5,0.3.
    preset, kind
        Preset and kind of the finger.
    speed, inertia, output
        Speed of the slide, mm/s; whether inertia acts; distance between outputs, mm.
    periods
        Number of periods that are slid; the last is kept.
    """
    of_run = f"{kind}_{preset}" + (f"_{speed:g}" if speed != SPEED_MM_S else "")
    of_run += ("_inertia" if inertia else "") + (f"_{periods}periods" if periods > 1 else "")
    for condition in [Condition.parsed(text) for text in conditions] or CONDITIONS:
        path = folder / f"{of_run}_{condition}.npz"
        for surface in surfaces:
            if surface in Kept.of(path).surfaces:
                continue
            one = study(
                surface,
                condition,
                preset=preset,
                kind=kind,
                speed_mm_s=speed,
                inertia=inertia,
                output_mm=output,
                periods=periods,
            )
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
