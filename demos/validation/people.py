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
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem import Results, Study, run_script, write_table
from tactile_fem.calibration.measurements import Experiment, read_measurements
from tactile_fem.people import Ensemble, people, run_people
from tactile_fem.people.bands import bands_table
from tactile_fem.people.causes import causes, causes_table
from tactile_fem.people.figures import causes_figure
from tactile_fem.runtime.files import write_figure
from tactile_fem.series import Member

Array = NDArray[np.float64]

MEASURED = Path(__file__).parent / "measured"
# Mean and standard deviation of the forces of so many people; where an adult is three pads.
FILES = {"plate": "plate.csv", "probe": "probe.csv", "sphere": "not_fitted/sphere.csv"}
COUNTS = {"plate": 4, "probe": 4, "sphere": 7}
AGAIN, SEED = 20_000, 1
# Steps that are long enough for forces, as in the fit of the finger.
LONG = {"first_step_mm": 0.25, "max_press_step_mm": 0.5}


def measured() -> dict[str, Experiment]:
    """Return what was measured, by the name of the indenter."""
    return {name: read_measurements([MEASURED / file])[0] for name, file in FILES.items()}


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
        Folder for scans, tables and the figure.
    number
        Number of people.
    pad_size, far_size
        Mesh sizes, mm.
    deepest
        Largest depth, mm.
    jobs
        Parallel scans.
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


def upto(one: Experiment, deepest_mm: float) -> Experiment:
    """Return what was measured at no larger depths."""
    own = one.depth_mm <= deepest_mm
    return replace(one, depth_mm=one.depth_mm[own], mean=one.mean[own], sd=one.sd[own])


def study(one: Experiment, finger: Mapping[str, Any]) -> Study:
    """Return the study of a press that stops at each depth."""
    path = [{"kind": "press", "depth_mm": depth} for depth in one.depth_mm.tolist()]
    return Study.model_validate(
        {
            "finger": finger,
            "stimulus": one.indenter.model_dump(mode="json", exclude_none=True),
            "protocol": {"path": path},
            "solver": LONG,
            "output": {"pictures": False},
        }
    )


def at_depths(one: Experiment, scan: Results) -> Array:
    """Return the normal forces of a scan at the depths, N, (n,)."""
    trace = scan.trace
    return np.interp(one.depth_mm, trace["stimulator_mm"][:, 2], trace["force_N"][:, 2])


# %%
def rows_of(name: str, one: Experiment, force_N: Array) -> list[dict[str, str]]:
    """Return mean and variation at each depth, of people and of the model (people, n)."""
    few = spread_of_few(force_N, COUNTS[name])
    low, high = np.quantile(few, [0.05, 0.95], axis=0)
    met = (one.sd / one.mean >= low) & (one.sd / one.mean <= high)
    return [
        {
            "indenter": name,
            "depth, mm": f"{one.depth_mm[k]:g}",
            "people: mean, N": f"{one.mean[k]:.3f}",
            "model": f"{force_N[:, k].mean():.3f}",
            "people: sd/mean": f"{one.sd[k] / one.mean[k]:.2f}",
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
    folder: Path, ensemble: Ensemble, presses: Mapping[str, Experiment], forces: Mapping[str, Array]
) -> None:
    """Print and draw what the forces at the largest depths are, and what they come from."""
    labels = {name: f"{name}, {one.depth_mm[-1]:g} mm (N)" for name, one in presses.items()}
    deepest = {labels[name]: force[:, -1] for name, force in forces.items()}
    scores = ensemble.draws[ensemble.complete]
    tables = [bands_table(deepest)]
    if len(scores) >= len(ensemble.names) + 2:
        found = {
            name: causes(scores, ensemble.names, np.log(f), independent=True)
            for name, f in deepest.items()
        }
        tables.append(causes_table(found))
        write_figure(folder / "causes.png", causes_figure(found))
    for rows in tables:
        print()
        for row in rows:
            print(f"| {' | '.join(row)} |")


# %%
if __name__ == "__main__":
    run_script(main)
