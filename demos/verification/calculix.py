# %% [markdown]
# # The same press and slide with CalculiX
#
# This demo emphasizes
# - how a study becomes an input deck for another finite element code (`tactile_fem.deck`),
# - whether two codes that share nothing but the mesh find the same forces,
# - what each of them needs: iterations, seconds.
#
# Same nodes and tetrahedra, same energies, same held nodes, same increments, no viscosity. What
# differs is the contact: here Nitsche's method against the stimulator's smooth distance, there
#
# $$p = k\,[-g]_+,\qquad k = \gamma E/h,$$
#
# a penalty of Nitsche's own stiffness (Young's modulus $E$ and thickness $h$ of the stratum
# corneum), integrated over the overlap of skin facets with a height field of small flat squares.
# The skin then sinks into the stimulator by $p/k$, a few micrometres.
#
# On a plate the forces agree within a few thousandths. On a curved body CalculiX's tangential
# force depends on the increment of the slide, as if the contact's geometry lagged behind: a bar of
# 1.585 mm radius without friction, slid on a symmetric block, drags it with 0.080, 0.053, 0.027
# and 0.009 of the normal force at increments of 0.2, 0.1, 0.05 and 0.025 mm. For a fair tangential
# force take `--slide-step 0.025`.
#
#     python demos/benchmarks/calculix.py results/calculix
#     python demos/benchmarks/calculix.py results/letters --stimulus letters --depth 1.0
#     python demos/benchmarks/calculix.py results/small --pad-size 2.5 --far-size 6 --rows 1
#
# (The last one makes a mesh of its own, which needs gmsh.) CalculiX is the program `ccx`
# (Debian: `apt-get install calculix-ccx`). Its time grows with nearly the square of the unknowns,
# so `--timeout` ends it; the table then tells how far it came.

# %%
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from cyclopts import run

from tactile_fem.deck import DeckSize, write_deck
from tactile_fem.files import write_table, write_text
from tactile_fem.finger import load_finger
from tactile_fem.results import Results
from tactile_fem.study import (
    Cylinder,
    Finger,
    Output,
    Plate,
    Protocol,
    Receptors,
    Solver,
    Study,
    Text,
    Tissue,
)
from tactile_fem.study_file import dump_study

# Height fields are as coarse as the body allows: CalculiX integrates over each of their squares.
GRIDS_MM = {"plate": (4.0, 4.0), "cylinder": (4.0, 0.1), "letters": (0.1, 0.1)}
STIMULI = {
    "plate": Plate(friction=0.3),
    "cylinder": Cylinder(friction=0.3),
    "letters": Text(friction=0.3),
}


@dataclass(frozen=True)
class Outcome:
    """What a code did; forces are on the finger, None where it did not get so far.

    `seconds` is wall time without start-up; `cpu_seconds` is that of all cores, start-up
    included, and hardly changes when the computer has other work too.
    """

    code: str
    tetrahedra: int
    unknowns: int
    cores: int
    finished: bool
    steps: int
    iterations: int
    seconds: float
    cpu_seconds: float
    seconds_per_iteration: float
    press_normal_N: float | None
    slide_normal_N: float | None
    slide_tangential_N: float | None


# %% [markdown]
# Equal steps: first and longest step are the same, so that neither code chooses its own.


# %%
def main(
    folder: Path,
    *,
    stimulus: Literal["plate", "cylinder", "letters"] = "cylinder",
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    rows: int | None = None,
    depth: float = 0.5,
    distance: float = 0.4,
    press_step: float = 0.1,
    slide_step: float = 0.1,
    viscous_time: float = 0.0,
    cores: int = 2,
    timeout: float = 3600.0,
) -> None:
    """Press and slide with both codes and compare them; lengths in mm, times in s."""
    if not shutil.which("ccx"):
        print("CalculiX is not installed: there is no ccx on the path, so nothing is compared.")
        return
    study = Study(
        finger=Finger(
            preset=preset, pad_size_mm=pad_size, far_size_mm=far_size, epidermis_rows=rows
        ),
        tissue=Tissue.model_validate({"viscous_time_s": viscous_time}),
        stimulus=STIMULI[stimulus],
        protocol=Protocol(depth_mm=depth, distance_mm=distance, output_mm=distance),
        receptors=Receptors(spacing_mm=5.0),
        solver=Solver(
            first_step_mm=press_step,
            max_press_step_mm=press_step,
            first_slide_step_mm=slide_step,
            max_slide_step_mm=slide_step,
        ),
        output=Output(fields_mm=1000.0, pictures=False),
    )
    (folder / "calculix").mkdir(parents=True, exist_ok=True)
    deck = folder / "calculix" / "deck.inp"
    size = write_deck(study, load_finger(study.finger), deck, grid_mm=GRIDS_MM[stimulus])
    outcomes = [ours(study, size, folder, cores), theirs(deck, size, cores, timeout)]
    tell(outcomes)
    write_table(folder / "comparison.csv", outcomes)


# %% [markdown]
# This package, from its command line. The seconds are those of the march, without compiling
# the forms, which happens once per computer. Iterations of steps that failed count as well.


# %%
def ours(study: Study, size: DeckSize, folder: Path, cores: int) -> Outcome:
    """Run the scan in a process of its own and read what it left."""
    write_text(folder / "study.toml", dump_study(study))
    command = [sys.executable, "-m", "tactile_fem", "scan", str(folder / "study.toml")]
    command += ["--results", str(folder / "scan"), "--overwrite", "--ranks", str(cores)]
    cpu = cpu_of_children()
    finished = subprocess.run(command, check=False).returncode == 0
    cpu = cpu_of_children() - cpu
    results = Results.open(folder / "scan")
    trace, seconds = results.trace, results.run["wall_s"]
    iterations = int(trace["newton_iterations"].sum())
    force, sliding = trace["force_N"], trace["displacement_mm"] > 0
    return Outcome(
        "tactile_fem",
        size.tets,
        size.unknowns,
        cores,
        finished,
        len(force) - 1,
        iterations,
        seconds,
        cpu,
        seconds / iterations,
        *forces(force, np.count_nonzero(~sliding), finished),
    )


def forces(force: np.ndarray, pressed: int, finished: bool) -> tuple[float | None, ...]:
    """Return the normal force after `pressed` rows, normal and tangential force at the end."""
    whole_press = finished or len(force) > pressed
    return (
        float(force[pressed - 1, 2]) if whole_press else None,
        float(force[-1, 2]) if finished else None,
        -float(force[-1, 1]) if finished else None,
    )


# %% [markdown]
# CalculiX tells its increments in `.sta`, its iterations in `.cvg`, sums of forces in `.dat`.


# %%
def theirs(deck: Path, size: DeckSize, cores: int, timeout: float) -> Outcome:
    """Run the deck, for at most `timeout` seconds, and read what it left."""
    variables = ("OMP_NUM_THREADS", "CCX_NPROC_STIFFNESS", "CCX_NPROC_RESULTS")
    environment = os.environ | dict.fromkeys(variables, str(cores))
    for suffix in (".sta", ".cvg", ".dat"):
        deck.with_suffix(suffix).unlink(missing_ok=True)
    started, cpu = time.perf_counter(), cpu_of_children()
    with open(deck.with_suffix(".log"), "w", encoding="utf-8") as log:
        try:
            command = ["ccx", "-i", deck.stem]
            subprocess.run(
                command, cwd=deck.parent, env=environment, stdout=log, stderr=log, timeout=timeout
            )
        except subprocess.TimeoutExpired:
            print(f"CalculiX was stopped after {timeout:.0f} s.")
    seconds = time.perf_counter() - started
    finished = "Job finished" in text_of(deck.with_suffix(".log"))
    steps = [row[0] for row in rows_of(deck.with_suffix(".sta")) if not row[2].endswith("U")]
    iterations = len(rows_of(deck.with_suffix(".cvg")))
    total = r"total force .* set STIMULATOR .*\s+(\S+)\s+(\S+)\s+(\S+)"
    force = np.array(re.findall(total, text_of(deck.with_suffix(".dat"))), dtype=float)
    return Outcome(
        "CalculiX",
        size.tets,
        size.unknowns,
        cores,
        finished,
        len(steps),
        iterations,
        seconds,
        cpu_of_children() - cpu,
        seconds / max(iterations, 1),
        *forces(force, steps.count("1"), finished),
    )


def cpu_of_children() -> float:
    """Return the CPU time, in s, of all processes that were started and have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def rows_of(path: Path) -> list[list[str]]:
    """Return the rows of a CalculiX table, without its heading."""
    return [line.split() for line in text_of(path).splitlines() if re.match(r"\s*\d", line)]


def text_of(path: Path) -> str:
    """Return a file's text; nothing if CalculiX did not come to write it."""
    return path.read_text(encoding="utf-8") if path.exists() else ""


# %%
def tell(outcomes: list[Outcome]) -> None:
    """Print the outcomes side by side."""
    first, second = map(asdict, outcomes)
    for name in first:
        pair = (shown(outcome[name]) for outcome in (first, second))
        print(f"{name.replace('_', ' '):24}{'  '.join(f'{text:>12}' for text in pair)}")
    whole = all(outcome.finished for outcome in outcomes)
    name = "seconds" if whole else "seconds_per_iteration"
    print(f"ratio of {name.replace('_', ' ')}: {second[name] / first[name]:.1f}")


def shown(value: str | float | bool | None) -> str:
    """Return a value as it stands in the table."""
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.4g}"
        case _:
            return str(value)


# %%
if __name__ == "__main__":
    run(main)
