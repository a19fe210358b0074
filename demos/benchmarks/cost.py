# %% [markdown]
# # Cost of a scan
#
# Each scan runs in a process of its own, through the command line; the numbers are those of its
# results folder. Scans that are complete are not repeated, and one that was cut off continues. The
# first scan on a computer compiles the forms as well: start with a short one (`--distance 0.1`).
#
#     python demos/benchmarks/cost.py results/cost --sizes coarse medium paper
#     python demos/benchmarks/cost.py results/cost --cases section
#     python demos/benchmarks/cost.py results/cost --cases default relaxing force --distance 2
#     python demos/benchmarks/cost.py results/cost --sizes coarse paper --ranks 2 4 8 16
#     python demos/benchmarks/cost.py results/cost --cases long --distance 5    # 5,000 steps
#
# The normal force at the end is equal on any number of ranks.

# %%
import resource
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from tactile_fem import Results, load_study, run_script, write_table
from tactile_fem.series import Member, run_all

SIZES = {
    "small": ["finger.pad_size_mm=3", "finger.far_size_mm=6"],
    "coarse": ["finger.preset=coarse"],
    "medium": ["finger.preset=medium"],
    "paper": ["finger.preset=paper"],
}
CASES = {
    "default": [],
    "section": ["finger.kind=section", "protocol.force_N=0.06"],
    "long": ["finger.kind=section", "protocol.force_N=0.06", "protocol.output_mm=0.001"],
    "relaxing": ["tissue.relaxation=fingerpad"],
    "force": ["protocol.force_N=0.4", "protocol.hold=force"],
    "direct": ["solver.linear=direct"],
}
Many = Parameter(consume_multiple=True)


@dataclass(frozen=True)
class Cost:
    """Cost of one scan; seconds are wall time of the first rank, memory is that of all ranks.

    `cpu_s` is the processor time of all ranks, which hardly changes when the computer has other
    work too, `written_MB` what they wrote on disks; 0 for a scan that was complete before.
    """

    case: str
    size: str
    ranks: int
    cells: int
    unknowns: int
    steps: int
    newton: int
    linear: int
    cpu_s: float
    written_MB: float
    seconds: float
    per_newton_s: float
    assembly_s: float
    contact_s: float
    set_up_s: float
    linear_s: float
    receptors_s: float
    memory_GB: float
    force_N: float


# %%
def main(
    folder: Path,
    *,
    sizes: Annotated[tuple[str, ...], Many] = ("coarse",),
    cases: Annotated[tuple[str, ...], Many] = ("default",),
    ranks: Annotated[tuple[int, ...], Many] = (1,),
    distance: float = 10.0,
    depth: float = 1.97,
) -> None:
    """Scan each size in each case on each number of MPI ranks; print and save the table.

    Parameters
    ----------
    folder
        Folder for the scans and `costs.csv`.
    sizes, cases
        Meshes and changes of the default study, by the names above.
    ranks
        Numbers of MPI ranks.
    distance, depth
        Length of the slide and depth of the press, mm; "section", "long" and "force" press to a
        force.
    """
    costs = []
    print("".join(f"{field.name:>13}" for field in fields(Cost)))
    for case, size, count in ((c, s, n) for c in cases for s in sizes for n in ranks):
        depths = [] if case in ("section", "long", "force") else [f"protocol.depth_mm={depth}"]
        way = [*depths, f"protocol.distance_mm={distance}", "output.pictures=false"]
        study = load_study(None, SIZES[size] + CASES[case] + way)
        member = Member(f"{case}-{size}-{count}", study, {})
        before = spent_by_children()
        (results,) = run_all([member], folder, ranks=count)
        costs.append(cost_of(case, size, results, *(spent_by_children() - before)))
        print("".join(f"{shown(value):>13}" for value in vars(costs[-1]).values()), flush=True)
        write_table(folder / "costs.csv", costs)


def spent_by_children() -> np.ndarray:
    """Return processor time, s, and MB written by all processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return np.array([usage.ru_utime + usage.ru_stime, usage.ru_oublock * 512 / 1e6])


def cost_of(case: str, size: str, results: Results, cpu_s: float, written_MB: float) -> Cost:
    """Read the results of a scan."""
    run, trace = results.run, results.trace
    mesh = run["mesh"]
    timer = {name: run["timers_s"].get(name, 0.0) for name in TIMERS}
    newton = int(trace["newton_iterations"].sum())
    assembly, contact = timer["jacobian"] + timer["residual"], timer["obstacle"]
    set_up = timer["preconditioner"]
    return Cost(
        case=case,
        size=size,
        ranks=run["ranks"],
        cells=mesh["triangles" if "triangles" in mesh else "tetrahedra"],
        unknowns=mesh["unknowns"],
        steps=len(trace["time_s"]) - 1,
        newton=newton,
        linear=int(trace["linear_iterations"].sum()),
        cpu_s=float(cpu_s),
        written_MB=float(written_MB),
        seconds=run["wall_s"],
        per_newton_s=timer["solve"] / newton,
        assembly_s=assembly,
        contact_s=contact,
        set_up_s=set_up,
        linear_s=timer["solve"] - assembly - contact - set_up,
        receptors_s=timer["load"] + timer["probe"],
        memory_GB=run["peak_memory_MB"] / 1000,
        force_N=float(trace["force_N"][-1, 2]),
    )


TIMERS = ("solve", "jacobian", "residual", "obstacle", "preconditioner", "load", "probe")


def shown(value: str | float) -> str:
    """Return a value as in the table."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


# %%
if __name__ == "__main__":
    run_script(main)
