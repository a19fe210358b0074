# %% [markdown]
# # Cost of a scan
#
# This benchmark emphasizes
# - where the time goes: assembly, contact, preconditioner, linear solve, receptors, output,
# - how the cost grows with the number of unknowns (the exponent is fitted),
# - the speed-up by a second core.
#
# Each scan runs in its own process through the command line; the numbers come from its results
# folder. The first scan on a computer also compiles the forms, which is not counted.
#
#     python demos/benchmarks/cost.py costs                       # a short press and slide
#     python demos/benchmarks/cost.py costs --sizes coarse --sizes medium --sizes paper \
#         --depth 1.97 --distance 10 --ranks 2                    # the paper's protocol
#
# A size is a preset or the element edges under the pad and far from it in mm, as in `0.6,1.8`.

# %%
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from tactile_fem import Results, Study, run_script, write_table
from tactile_fem.runtime.files import write_text
from tactile_fem.series import Member, run_all
from tactile_fem.study import Finger, Output, Protocol, Solver

# %% [markdown]
# One row of the table. Seconds are wall time of the first rank.


# %%
@dataclass(frozen=True)
class Cost:
    """Cost of one scan."""

    size: str
    cells: int
    unknowns: int
    ranks: int
    steps: int
    newton: int
    linear: int
    seconds: float
    assembly_s: float
    contact_s: float
    set_up_s: float
    linear_s: float
    receptors_s: float
    output_s: float
    memory_MB: float
    force_N: float

    @classmethod
    def of(cls, size: str, results: Results) -> "Cost":
        """Read the results of a scan."""
        run_, trace = results.run, results.trace
        part = {name: run_["timers_s"].get(name, 0.0) for name in (*SOLVING, *AROUND)}
        return cls(
            size,
            run_["mesh"]["tetrahedra"],
            run_["mesh"]["unknowns"],
            run_["ranks"],
            len(trace["time_s"]) - 1,
            int(trace["newton_iterations"].sum()),
            int(trace["linear_iterations"].sum()),
            run_["wall_s"],
            part["jacobian"] + part["residual"],
            part["obstacle"],
            part["preconditioner"],
            part["solve"] - sum(part[name] for name in SOLVING[1:]),
            part["load"] + part["probe"],
            part["output"],
            run_["peak_memory_MB"],
            float(trace["force_N"][-1, 2]),
        )


SOLVING = ("solve", "jacobian", "residual", "obstacle", "preconditioner")
AROUND = ("load", "probe", "output")


# %%
def main(
    folder: Path,
    *,
    sizes: list[str] | None = None,
    ranks: list[int] | None = None,
    depth: float = 0.3,
    distance: float = 0.1,
    linear: str = "multigrid",
) -> None:
    """Scan each size on each number of ranks; print and save the table.

    Parameters
    ----------
    folder
        Where the scans and `costs.csv`, `costs.json` go; scans that are there are not run again,
        and one that was cut off goes on.
    sizes
        Presets, or pairs of element edges "pad,far" in mm; default coarse and medium.
    ranks
        Numbers of MPI ranks; default 1 and 2.
    depth, distance
        Of the press and of the slide, in mm.
    linear
        The linear solver.
    """
    sizes, ranks = sizes or ["coarse", "medium"], ranks or [1, 2]
    costs = []
    for size in sizes:
        for count in ranks:
            study = Study(
                finger=finger_of(size),
                protocol=Protocol(depth_mm=depth, distance_mm=distance),
                solver=Solver(linear=linear),
                output=Output(pictures=False, states_mm=5.0),
            )
            member = Member(f"{size.replace(',', '-')}-{count}", study, {})
            [results] = run_all([member], folder, ranks=count)
            costs.append(Cost.of(size, results))
            print_results(costs[-1:], heading=len(costs) == 1)
    keep(folder, costs)
    for count in ranks:
        print_exponent([cost for cost in costs if cost.ranks == count])


# %%
def finger_of(size: str) -> Finger:
    """Return the finger of a preset or of a pair of element edges."""
    if "," not in size:
        return Finger(preset=size)
    pad, far = map(float, size.split(","))
    return Finger(preset="medium", pad_size_mm=pad, far_size_mm=far)


# %% [markdown]
# The exponent $p$ of $\text{seconds} \propto \text{unknowns}^p$, once for the whole scan and once
# for a Newton iteration: a finer mesh may need more iterations.


# %%
def print_exponent(costs: list[Cost]) -> None:
    """Print the exponents over the sizes, if there are several."""
    unknowns = np.log([cost.unknowns for cost in costs])
    if len(set(unknowns)) < 2:
        return
    whole = np.polyfit(unknowns, np.log([cost.seconds for cost in costs]), 1)[0]
    newton = np.polyfit(unknowns, np.log([c.seconds / c.newton for c in costs]), 1)[0]
    print(f"{costs[0].ranks} ranks: seconds grow with unknowns^{whole:.2f}, ", end="")
    print(f"those of a Newton iteration with unknowns^{newton:.2f}")


def print_results(costs: list[Cost], heading: bool) -> None:
    """Print rows of the table."""
    names = list(asdict(costs[0]))
    if heading:
        print(" ".join(f"{name:>10}" for name in names), flush=True)
    for cost in costs:
        print(" ".join(f"{shown(value):>10}" for value in asdict(cost).values()), flush=True)


def shown(value: str | float) -> str:
    """Return a value as shown in the table."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def keep(folder: Path, costs: list[Cost]) -> None:
    """Write the table as CSV and JSON."""
    write_table(folder / "costs.csv", costs)
    write_text(folder / "costs.json", json.dumps([asdict(cost) for cost in costs], indent=1))


# %%
if __name__ == "__main__":
    run_script(main)
