# %% [markdown]
# # Two revisions side by side
#
# Each case runs with the two revisions in turn, on the same meshes, in clones of this repository
# and in processes of their own: computers are faster at one hour than at another, so only pairs
# compare. Each run adds a line to `benchmarks.jsonl`, which is kept from revision to revision and
# drawn as `benchmarks.png`.
#
#     python demos/benchmarks/revisions.py results/benchmarks --before v0.1.0
#     python demos/benchmarks/revisions.py results/benchmarks --before 9db47ef --cases coarse paper
#
# | case | what is timed |
# | --- | --- |
# | import | `import tactile_fem` |
# | afferents | a second of 10,000 afferents |
# | fast, busy | a letter scan of the fast finger, alone and beside two busy processes |
# | coarse, paper | the default scan with the default finger and at full size |
# | press | 20 steps at full size |
# | sweep | six scans with the default finger, pressed to 0.3 mm |
# | clone | from a fresh clone with a cold cache to the pictures of the default scan |
# | test | `make test` in a fresh clone with a cold cache |
#
# The environment is this one's, but for `clone` and `test`. What is not committed is not measured.

# %%
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Annotated, Any

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import Parameter

from tactile_fem import StudyError, run_script

HERE = Path(__file__).parent
Record = dict[str, Any]
Many = Parameter(consume_multiple=True)


# %%
def main(
    folder: Path,
    *,
    before: str = "HEAD~1",
    after: str = "HEAD",
    cases: Annotated[tuple[str, ...], Many] = ("import", "afferents", "fast", "busy", "coarse"),
    tries: int = 2,
    ranks: int = 2,
) -> None:
    """Time both revisions; print a table of medians, and add to the history.

    Parameters
    ----------
    folder
        Folder for the clones, the last scans and the history.
    before, after
        Revisions, as git names them.
    cases
        Names as above.
    tries
        Runs of each case with each revision.
    ranks
        MPI ranks of a scan.
    """
    if unknown := set(cases) - set(CASES):
        raise StudyError(f"cases: there is no {', '.join(unknown)}, only {', '.join(CASES)}.")
    folder.mkdir(parents=True, exist_ok=True)
    trees = [clone(folder.resolve() / "revisions", name) for name in (before, after)]
    history = folder / "benchmarks.jsonl"
    print(f"{'case':>10} {'before':>9} {'after':>9} {'ratio':>6}  of the last runs")
    for case in cases:
        taken: list[list[Record]] = [[], []]
        for _ in range(tries):
            for tree, records in zip(trees, taken, strict=True):
                measured = CASES[case](tree, trees, ranks)
                records.append({"case": case, "revision": tree.name, **about(ranks), **measured})
                with history.open("a") as file:
                    file.write(json.dumps(records[-1]) + "\n")
        old_s, new_s = (median(one["seconds"] for one in records) for records in taken)
        pairs = [new["seconds"] / old["seconds"] for old, new in zip(*taken, strict=True)]
        said = [said_of(records[-1]) for records in taken]
        print(f"{case:>10} {old_s:>9.4g} {new_s:>9.4g} {median(pairs):>6.2f}  {said[0]}")
        print(f"{'':>37}  {said[1]}{differences(trees, case)}", flush=True)
    draw(history, folder / "benchmarks.png")


def clone(folder: Path, revision: str) -> Path:
    """Return a clone of this repository at a revision, named by it."""
    name = output_of(["git", "rev-parse", "--short", f"{revision}^{{commit}}"], cwd=HERE).strip()
    tree = folder / name
    if not tree.exists():
        top = output_of(["git", "rev-parse", "--show-toplevel"], cwd=HERE).strip()
        output_of(["git", "clone", "--quiet", top, str(tree)])
        output_of(["git", "checkout", "--quiet", "--detach", name], cwd=tree)
    return tree


def about(ranks: int) -> Record:
    """Return when and on what computer a run is."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "processor": names[0] if names else platform.processor(),
        "cores": os.cpu_count(),
        "ranks": ranks,
    }


def said_of(record: Record) -> str:
    """Return a record's own numbers in words."""
    own = {k: v for k, v in record.items() if k not in ("case", "revision", "seconds", *about(1))}
    return ", ".join(f"{name} {value:.4g}" for name, value in own.items())


# %% [markdown]
# ## Cases
#
# Each returns its numbers, of which `seconds` are compared.


# %%
def output_of(command: list[str], cwd: Path | None = None, **environment: str) -> str:
    """Run a command; return what it prints.

    Raises
    ------
    SystemExit
        It fails; with the end of what it said.
    """
    found = subprocess.run(
        command, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True
    )
    if found.returncode:
        raise SystemExit(
            f"{' '.join(command)} failed:\n{found.stdout[-500:]}{found.stderr[-2000:]}"
        )
    return found.stdout


def run_python(tree: Path, *arguments: str) -> str:
    """Run this Python with the package of a revision, away from any sources."""
    with tempfile.TemporaryDirectory() as away:
        return output_of([sys.executable, *arguments], Path(away), PYTHONPATH=str(tree))


def timed(work: Callable[[], object]) -> Record:
    """Return the wall time of a call."""
    start = perf_counter()
    work()
    return {"seconds": perf_counter() - start}


def script(name: str, tree: Path, trees: list[Path], ranks: int) -> Record:
    """Return what one of the scripts here prints last."""
    file, *arguments = name.split()
    return json.loads(run_python(tree, str(HERE / file), *arguments).splitlines()[-1])


def imported(tree: Path, trees: list[Path], ranks: int) -> Record:
    """Time an import in a new process."""
    return timed(lambda: run_python(tree, "-c", "import tactile_fem"))


def scanned(case: str, values: list[str], tree: Path, trees: list[Path], ranks: int) -> Record:
    """Scan on the mesh of the first revision."""
    mesh = trees[0] / f"{case}.msh"
    if not mesh.exists():
        run_python(trees[0], "-m", "tactile_fem", "mesh", *sets(values[:1]), "-o", str(mesh))
    command = ["-m", "tactile_fem", "scan", "--ranks", str(ranks), "--overwrite"]
    common = [f"finger.mesh_file={mesh}", "output.pictures=false"]
    compiled = tree / "compiled"
    if not compiled.exists():
        short = ["protocol.depth_mm=0.05", "protocol.distance_mm=0.1"]
        run_python(
            tree, *command, "--results", str(compiled), *sets(["output.pictures=false", *short])
        )
    result = results_of(tree, case)
    run_python(tree, *command, "--results", str(result), *sets(common + values[1:]))
    run = json.loads((result / "run.json").read_text())
    with np.load(result / "trace.npz") as trace:
        newton, linear = trace["newton_iterations"].sum(), trace["linear_iterations"].sum()
    return {
        "seconds": run["wall_s"],
        "newton": int(newton),
        "linear": int(linear),
        "memory_GB": run["peak_memory_MB"] / 1000,
    }


def results_of(tree: Path, case: str) -> Path:
    """Return the folder of the last scan."""
    return tree / "results" / f"benchmark-{case}"


def sets(values: list[str]) -> list[str]:
    """Return values as the command line takes them."""
    return [word for value in values for word in ("--set", value)]


def swept(tree: Path, trees: list[Path], ranks: int) -> Record:
    """Time a sweep of six scans."""
    way = ["protocol.depth_mm=0.3", "protocol.distance_mm=0.2", "output.pictures=false"]
    angles = "stimulus.angle_deg=" + ",".join(map(str, range(0, 60, 10)))
    with tempfile.TemporaryDirectory() as folder:
        command = ["-m", "tactile_fem", "sweep", "--over", angles, "--results", folder]
        return timed(lambda: run_python(tree, *command, *sets(way)))


def made(target: str, tree: Path, trees: list[Path], ranks: int) -> Record:
    """Time a target of the Makefile in a clone of the clone, with cold caches."""
    with tempfile.TemporaryDirectory() as folder:
        fresh, cache = Path(folder, "clone"), Path(folder, "cache")

        def make() -> None:
            output_of(["git", "clone", "--quiet", str(tree), str(fresh)])
            output_of(["make", target], fresh, XDG_CACHE_HOME=str(cache), PYTHONPATH="")

        return timed(make)


CASES: dict[str, Callable[[Path, list[Path], int], Record]] = {
    "import": imported,
    "afferents": partial(script, "afferents.py"),
    "fast": partial(script, "fast.py --beside 0"),
    "busy": partial(script, "fast.py --beside 2"),
    "coarse": partial(scanned, "coarse", ["finger.preset=coarse"]),
    "press": partial(
        scanned,
        "press",
        ["finger.preset=paper", "protocol.depth_mm=1.8", "protocol.distance_mm=0"],
    ),
    "paper": partial(scanned, "paper", ["finger.preset=paper"]),
    "sweep": swept,
    "clone": partial(made, "scan"),
    "test": partial(made, "test"),
}


# %%
def differences(trees: list[Path], case: str) -> str:
    """Return by how much forces and strain energy densities of two scans differ, in words."""
    files = [results_of(tree, case) / "trace.npz" for tree in trees]
    if not all(file.exists() for file in files):
        return ""
    said = ""
    with np.load(files[0]) as first, np.load(files[1]) as second:
        for name in ("force_N", "sed_kPa"):
            a, b = first[name], second[name]
            said += f", {name} differ by {np.abs(a - b).max() / np.abs(a).max():.1e}"
    return said


def draw(history: Path, file: Path) -> None:
    """Draw the time of each case as a share of its first, revision by revision."""
    records = [json.loads(line) for line in history.read_text().splitlines()]
    revisions = list(dict.fromkeys(record["revision"] for record in records))
    figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    for case in dict.fromkeys(record["case"] for record in records):
        taken: dict[str, list[float]] = {}
        for record in records:
            if record["case"] == case:
                taken.setdefault(record["revision"], []).append(record["seconds"])
        seconds = np.array([median(each) for each in taken.values()])
        label = f"{case}, {seconds[0]:.3g} s"
        axes.plot(
            [revisions.index(name) for name in taken], seconds / seconds[0], "o-", label=label
        )
    axes.set_xticks(range(len(revisions)), revisions, rotation=30, ha="right")
    axes.set_ylabel("Time / time of the first revision")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    figure.savefig(file, dpi=150)
    plt.close(figure)


# %%
if __name__ == "__main__":
    run_script(main)
