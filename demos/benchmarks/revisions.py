# %% [markdown]
# # Two revisions, side by side
#
# This benchmark emphasizes
# - the time that the same scan takes with two revisions of the package, from the command's start to
#   its end, pictures included if the study asks for them,
# - that they run in turns, since a machine's speed changes by the hour, and that ratios tell,
# - how far the receptors' strain energy densities are apart, as a share of the largest.
#
# A revision is a folder with the repository in it, made for instance by `git worktree add`. Run
# each once before, so that the forms are compiled.
#
#     git worktree add ../before v0.4
#     python demos/benchmarks/revisions.py turns ../before . --study study.toml --turns 2

# %%
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from tactile_fem import Results, TactileError, run_script, write_table


@dataclass(frozen=True)
class Turn:
    """One scan with one revision."""

    revision: str
    turn: int
    seconds: float
    scan_s: float
    newton: int
    linear: int
    memory_MB: float


# %%
def main(
    folder: Path,
    before: Path,
    after: Path,
    *,
    study: Path,
    turns: int = 2,
    ranks: int = 2,
) -> None:
    """Scan with both revisions in turns; print and save what each took.

    Parameters
    ----------
    folder
        Where the scans and `turns.csv` go; it must not exist.
    before, after
        Folders of the two revisions.
    study
        Study file, which both can read.
    turns
        Scans with each.
    ranks
        MPI ranks.
    """
    folder.mkdir(parents=True)
    found: dict[str, list[Turn]] = {"before": [], "after": []}
    for turn in range(1, turns + 1):
        # The second is the first in the next turn, so that neither always runs on a warmer machine.
        order = [("before", before), ("after", after)][:: -1 if turn % 2 == 0 else 1]
        for name, checkout in order:
            place = folder / f"{name}-{turn}"
            seconds = scan(checkout.resolve(), study.resolve(), place.resolve(), ranks)
            found[name].append(read(name, turn, seconds, Results(place)))
            print(shown(found[name][-1]), flush=True)
    write_table(folder / "turns.csv", [turn for turns_ in found.values() for turn in turns_])
    for name in ("seconds", "scan_s"):
        old, new = (median(getattr(turn, name) for turn in found[key]) for key in found)
        print(f"{name}: {old:.1f} before, {new:.1f} after, ratio {new / old:.2f}")
    print(difference(Results(folder / "before-1"), Results(folder / "after-1")))


# %%
def scan(checkout: Path, study: Path, place: Path, ranks: int) -> float:
    """Run the command line of a revision; return the seconds it took."""
    command = [sys.executable, "-m", "tactile_fem", "scan", str(study)]
    command += ["--results", str(place), "--ranks", str(ranks)]
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    started = time.perf_counter()
    done = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True)
    if done.returncode:
        last = (done.stdout + done.stderr).strip().splitlines()[-1:]
        raise TactileError(f"the scan with {checkout} failed: {' '.join(last)}")
    return time.perf_counter() - started


def read(name: str, turn: int, seconds: float, results: Results) -> Turn:
    """Return what a finished scan took."""
    trace, run_ = results.trace, results.run
    newton, linear = (int(trace[f"{kind}_iterations"].sum()) for kind in ("newton", "linear"))
    return Turn(name, turn, seconds, run_["wall_s"], newton, linear, run_["peak_memory_MB"])


def shown(turn: Turn) -> str:
    """Return a turn as a line."""
    return (
        f"{turn.revision:>7} {turn.turn}: {turn.seconds:.1f} s, scan {turn.scan_s:.1f} s, "
        f"{turn.newton} Newton and {turn.linear} linear iterations, {turn.memory_MB:.0f} MB"
    )


def difference(before: Results, after: Results) -> str:
    """Return how far the receptors' strain energy densities are apart at the same steps."""
    old, new = before.trace, after.trace
    if old["time_s"].shape != new["time_s"].shape or not np.allclose(old["time_s"], new["time_s"]):
        return "the steps differ"
    off = np.abs(old["sed_kPa"] - new["sed_kPa"]).max() / old["sed_kPa"].max()
    return f"strain energy densities differ by at most {off:.1e} of their maximum"


# %%
if __name__ == "__main__":
    run_script(main)
