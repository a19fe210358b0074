# %% [markdown]
# # The cost of tissue that relaxes
#
# This benchmark emphasizes
# - time and memory of a scan with a Prony series of three terms beside the same scan without,
# - time for each Newton iteration, because relaxing tissue is stiffer and needs other iterations.
#
# The two take turns, each scan in a process of its own, so that a machine whose speed changes
# treats them alike. What a first scan compiles is not counted if there are three turns or more.
#
#     python demos/benchmarks/relaxing.py results/relaxing --turns 3
#     python demos/benchmarks/relaxing.py results/relaxing --preset medium --turns 1

# %%
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Literal

from tactile_fem import Results, Study, run_script
from tactile_fem.series import Member, run_all
from tactile_fem.study import Finger, Output, Protocol, Text, Tissue

RELAXATIONS: tuple[Literal["none", "fingerpad"], ...] = ("none", "fingerpad")


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    turns: int = 1,
    ranks: int = 1,
    depth: float = 1.97,
    distance: float = 0.6,
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Press a G and slide a little with both tissues in turn; print medians and their ratios.

    Parameters
    ----------
    folder
        For the scans; complete ones are not repeated.
    preset, pad_size, far_size
        The mesh.
    turns
        How often.
    ranks
        Of each scan.
    depth, distance
        Of press and slide, mm.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    found: dict[str, list[Results]] = {relaxation: [] for relaxation in RELAXATIONS}
    for turn in range(1, turns + 1):
        for relaxation, runs in found.items():
            study = Study(
                finger=finger,
                tissue=Tissue(relaxation=relaxation),
                stimulus=Text(text="G"),
                protocol=Protocol(depth_mm=depth, distance_mm=distance, output_mm=0.2),
                output=Output(pictures=False),
            )
            member = Member(f"{relaxation}-{turn}", study, {})
            runs += run_all([member], folder, ranks=ranks)
    print("relaxation  steps  Newton  linear       s  s/Newton  memory MB")
    rows = {relaxation: row(runs) for relaxation, runs in found.items()}
    for relaxation, values in rows.items():
        print(f"{relaxation:10s} " + told(values))
    ratios = [b / a for a, b in zip(*rows.values(), strict=True)]
    print("ratio           " + " ".join(f"{ratio:7.2f}" for ratio in ratios))


def row(runs: Sequence[Results]) -> list[float]:
    """Return steps, iterations, seconds, seconds for each Newton iteration and memory in MB."""
    trace = runs[0].trace
    newton, linear = (int(trace[f"{kind}_iterations"].sum()) for kind in ("newton", "linear"))
    seconds = median(one.run["timers_s"]["solve"] for one in runs)
    memory = median(one.run["peak_memory_MB"] for one in runs)
    return [len(trace) - 1, newton, linear, seconds, seconds / newton, memory]


def told(values: Sequence[float]) -> str:
    """Return a row of the table."""
    steps, newton, linear, seconds, each, memory = values
    return f"{steps:6d}{newton:8d}{linear:8d}{seconds:8.1f}{each:10.3f}{memory:11.0f}"


# %%
if __name__ == "__main__":
    run_script(main)
