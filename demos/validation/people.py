# %% [markdown]
# # People, not one finger: is the spread of the model's forces that between people?
#
# Fingers are drawn from the shipped distribution (`tactile_fem.study.People`), whose sources are
# anatomy, friction and tissues, not these forces, and are pressed as people's were:
#
# - a plate and a flat probe: four subjects, the same for both (Gulati and Srinivasan, digitized by
#   others),
# - a sphere: seven adults, three pads of each. Its radius is unstated; with the 5 mm assumed here
#   the model has half the force.
#
# So few people have a wide range of spreads: as many as were measured are drawn out of the ensemble
# again and again. Then: what the spread comes from.
#
#     python demos/validation/people.py results/people --number 40
#     python demos/validation/people.py results/quick --number 8 --pad-size 3 --far-size 6

# %%
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem import Results, Study, run_script, write_table
from tactile_fem.people import Ensemble, people, run_people
from tactile_fem.people.bands import bands_table
from tactile_fem.people.causes import causes, causes_table
from tactile_fem.people.figures import causes_figure
from tactile_fem.runtime.files import write_figure
from tactile_fem.series import Member

Array = NDArray[np.float64]

# Forces of each subject, N, plate and probe in the same order.
PLATE_N = ((0.043, 0.227, 0.557, 1.039), (0.023, 0.110, 0.225, 0.504))
PLATE_N += ((0.045, 0.168, 0.458, 0.848), (0.037, 0.130, 0.341, 0.683))
PROBE_N = ((0.027, 0.088, 0.210, 0.386, 0.808, 1.475), (0.017, 0.065, 0.128, 0.224, 0.420, 0.673))
PROBE_N += ((0.022, 0.066, 0.193, 0.350, 0.584, 0.994), (0.032, 0.087, 0.123, 0.248, 0.444, 0.687))
SPHERE_MEAN_N = (0.024, 0.045, 0.071, 0.111, 0.154, 0.207, 0.274)
SPHERE_SD_N = (0.015, 0.030, 0.051, 0.070, 0.086, 0.105, 0.121)
PROBE = {"kind": "dots", "radius_mm": 3.175, "relief_mm": 4.0, "rows": 1, "columns": 1}
AGAIN, SEED = 20_000, 1
# Steps that are long enough for forces, as in the fit of the finger.
LONG = {"first_step_mm": 0.25, "max_press_step_mm": 0.5}


@dataclass(frozen=True)
class Pressed:
    """Forces that were measured under an indenter.

    Attributes
    ----------
    stimulus
        As in a study.
    depth_mm
        Depths, (n,).
    mean_N, sd_N
        Of people, (n,).
    people
        Their number.
    """

    stimulus: dict[str, Any]
    depth_mm: Array
    mean_N: Array
    sd_N: Array
    people: int


def measured() -> dict[str, Pressed]:
    """Return what was measured, by the name of the indenter."""
    plate, probe = np.array(PLATE_N), np.array(PROBE_N)
    return {
        "plate": _of_subjects({"kind": "plate"}, plate),
        "probe": _of_subjects(PROBE, probe),
        "sphere": Pressed(
            {"kind": "sphere", "radius_mm": 5.0},
            0.25 * np.arange(1, 8),
            np.array(SPHERE_MEAN_N),
            np.array(SPHERE_SD_N),
            7,
        ),
    }


def _of_subjects(stimulus: dict[str, Any], force_N: Array) -> Pressed:
    depth_mm = 0.5 * np.arange(1, force_N.shape[1] + 1)
    mean, sd = force_N.mean(axis=0), force_N.std(axis=0, ddof=1)
    return Pressed(stimulus, depth_mm, mean, sd, len(force_N))


# %%
def main(
    folder: Path,
    *,
    number: int = 40,
    pad_size: float | None = None,
    far_size: float | None = None,
    deepest: float = 3.0,
    jobs: int = 2,
) -> None:
    """Press a sample of people, and compare its spread with that of measured people.

    Parameters
    ----------
    folder
        For scans, tables and the figure.
    number
        Of people.
    pad_size, far_size
        Of the fingers' meshes, mm.
    deepest
        Press no deeper, mm.
    jobs
        Scans side by side.
    """
    sizes = {"pad_size_mm": pad_size, "far_size_mm": far_size}
    finger = {key: size for key, size in sizes.items() if size}
    presses = {name: upto(one, deepest) for name, one in measured().items()}
    conditions = [Member(name, study(one, finger), {}) for name, one in presses.items()]
    run_people(people(conditions, number), folder / "scans", jobs=jobs)
    ensemble = Ensemble.open(folder / "scans")
    for name, reason in ensemble.failed.items():
        print(f"{name} is missing: {reason}")
    forces = {
        name: np.array([at_depths(one, scan) for scan in ensemble.results(name)])
        for name, one in presses.items()
    }
    rows = [row for name, one in presses.items() for row in rows_of(name, one, forces[name])]
    write_table(folder / "spread.csv", rows)
    for row in [dict(zip(rows[0], rows[0], strict=True)), dict.fromkeys(rows[0], "---"), *rows]:
        print(f"| {' | '.join(row.values())} |", flush=True)
    explain(folder, ensemble, presses, forces)


def upto(one: Pressed, deepest_mm: float) -> Pressed:
    """Return what was measured at no larger depths."""
    own = one.depth_mm <= deepest_mm
    return Pressed(one.stimulus, one.depth_mm[own], one.mean_N[own], one.sd_N[own], one.people)


def study(one: Pressed, finger: Mapping[str, Any]) -> Study:
    """Return the study of a press that stops at each depth."""
    path = [{"kind": "press", "depth_mm": depth} for depth in one.depth_mm.tolist()]
    return Study.model_validate(
        {
            "finger": finger,
            "stimulus": one.stimulus,
            "protocol": {"path": path},
            "solver": LONG,
            "output": {"pictures": False},
        }
    )


def at_depths(one: Pressed, scan: Results) -> Array:
    """Return the normal forces of a scan at the depths, N, (n,)."""
    trace = scan.trace
    return np.interp(one.depth_mm, trace["stimulator_mm"][:, 2], trace["force_N"][:, 2])


# %%
def rows_of(name: str, one: Pressed, force_N: Array) -> list[dict[str, str]]:
    """Return mean and variation at each depth, of people and of the model (people, n)."""
    few = spread_of_few(force_N, one.people)
    low, high = np.quantile(few, [0.05, 0.95], axis=0)
    met = (one.sd_N / one.mean_N >= low) & (one.sd_N / one.mean_N <= high)
    return [
        {
            "indenter": name,
            "depth, mm": f"{one.depth_mm[k]:g}",
            "people: mean, N": f"{one.mean_N[k]:.3f}",
            "model": f"{force_N[:, k].mean():.3f}",
            "people: sd/mean": f"{one.sd_N[k] / one.mean_N[k]:.2f}",
            "all of the model": f"{variation(force_N)[k]:.2f}",
            "as few of the model, 90 %": f"{low[k]:.2f} to {high[k]:.2f}",
            "met": "yes" if met[k] else "**missed**",
        }
        for k in range(len(one.depth_mm))
    ]


def variation(force_N: Array) -> Array:
    """Return standard deviation over mean of people (..., people, n), (..., n)."""
    return np.asarray(force_N.std(axis=-2, ddof=1) / force_N.mean(axis=-2))


def spread_of_few(force_N: Array, count: int) -> Array:
    """Return the variation of so many people, drawn again and again from all, (AGAIN, n)."""
    rng = np.random.default_rng(SEED)
    each = np.array([rng.integers(len(force_N), size=count) for _ in range(AGAIN)])
    return variation(force_N[each])


def explain(
    folder: Path, ensemble: Ensemble, presses: Mapping[str, Pressed], forces: Mapping[str, Array]
) -> None:
    """Print and draw what the forces at the largest depths are, and what they come from."""
    labels = {name: f"{name}, {one.depth_mm[-1]:g} mm (N)" for name, one in presses.items()}
    deepest = {labels[name]: force[:, -1] for name, force in forces.items()}
    scores = ensemble.scores[ensemble.complete]
    tables = [bands_table(deepest)]
    if len(scores) >= len(ensemble.names) + 2:
        found = {name: causes(scores, ensemble.names, np.log(f)) for name, f in deepest.items()}
        tables.append(causes_table(found))
        write_figure(folder / "causes.png", causes_figure(found))
    for rows in tables:
        print()
        for row in rows:
            print(f"| {' | '.join(row)} |")


# %%
if __name__ == "__main__":
    run_script(main)
