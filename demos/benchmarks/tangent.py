# %% [markdown]
# # How long the tissues' part of the Jacobian may be kept
#
# This demo emphasizes
# - that a step's Newton iterations mostly look for the contact, while the tissues' tangent hardly
#   changes,
# - iterations and time for several values of `solver.tangent_iterations`; 1 is Newton's method.
#
# The values take turns, so that a machine whose speed changes treats them alike.
#
#     python demos/benchmarks/tangent.py --turns 2
#     python demos/benchmarks/tangent.py --iterations 1 5 --depth 0.3 --distance 0.04

# %%
from contextlib import closing
from dataclasses import dataclass, field
from statistics import median
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from tactile_fem import Simulation, Study, run_script
from tactile_fem.simulation.step import Step
from tactile_fem.study import Finger, Protocol, Solver, Text

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)


@dataclass
class Runs:
    """What one value took."""

    newton: int = 0
    linear: int = 0
    seconds: list[float] = field(default_factory=list)
    force_N: np.ndarray = field(default_factory=lambda: np.zeros(3))


# %%
def main(
    *,
    iterations: Annotated[tuple[int, ...], Parameter(consume_multiple=True)] = (1, 2, 3, 5, 8, 12),
    turns: int = 1,
    depth: float = 1.97,
    distance: float = 0.6,
    preset: str = "coarse",
) -> None:
    """Press a G and slide a little with each value."""
    found = {count: Runs() for count in iterations}
    for _ in range(turns):
        for count, runs in found.items():
            study = Study(
                finger=Finger(preset=preset),
                stimulus=Text(text="G"),
                protocol=Protocol(depth_mm=depth, distance_mm=distance, output_mm=0.2),
                solver=Solver(tangent_iterations=count),
            )
            with closing(Simulation(study)) as simulation:
                note(runs, list(simulation.steps()))
    if MPI.COMM_WORLD.rank == 0:
        tell(found)


def note(runs: Runs, steps: list[Step]) -> None:
    """Add the steps of one turn."""
    runs.newton = sum(step.newton_iterations for step in steps)
    runs.linear = sum(step.linear_iterations for step in steps)
    runs.seconds.append(sum(step.wall_s for step in steps))
    runs.force_N = steps[-1].force_N


def tell(found: dict[int, Runs]) -> None:
    """Print a row for each value."""
    first = next(iter(found.values()))
    print("kept for  Newton  linear       s   ratio  difference of force N")
    for count, runs in found.items():
        off = np.abs(runs.force_N - first.force_N).max()
        ratio = median(runs.seconds) / median(first.seconds)
        print(
            f"{count:8d}{runs.newton:8d}{runs.linear:8d}{median(runs.seconds):8.1f}{ratio:8.2f}"
            f"  {off:.1e}"
        )


if __name__ == "__main__":
    run_script(main)
