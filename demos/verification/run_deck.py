# %% [markdown]
# # A study with CalculiX
#
# The study is written as an input deck (`deck.py`), which is run if CalculiX (`ccx`; Debian:
# `apt-get install calculix-ccx`) is there. It writes increments to `.sta`, iterations to `.cvg`,
# sums of forces and energies to `.dat`. Its time grows with nearly the square of the unknowns.
# After `timeout` seconds it is stopped, and the results so far are printed.
#
#     python demos/verification/run_deck.py plate.inp --set stimulus.kind=plate --grid-mm 4

# %%
import os
import re
import resource
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from deck import write_deck

from tactile_fem import load_study, run_script
from tactile_fem.simulation.checks import checked_mesh

KPA_PER_MPA = 1000.0


# %%
@dataclass(frozen=True)
class DeckRun:
    """CalculiX's results for its accepted increments.

    Attributes
    ----------
    leg, share
        Step of the deck, from 0, and which share of it is done, (increments,).
    force_N
        On the finger, (increments, 3).
    sed_kPa
        Mean of each tetrahedron whose energy the deck prints, others 0, (increments, highest + 1).
    finished
        Whether it came to the deck's end.
    iterations, seconds, cpu_seconds
        Of all increments, wall time, time of all cores.
    """

    leg: np.ndarray
    share: np.ndarray
    force_N: np.ndarray
    sed_kPa: np.ndarray
    finished: bool
    iterations: int
    seconds: float
    cpu_seconds: float


def run_deck(deck: Path, *, cores: int = 1, timeout: float = 3600.0) -> DeckRun:
    """Run CalculiX in the deck's folder and read its output files."""
    variables = ("OMP_NUM_THREADS", "CCX_NPROC_STIFFNESS", "CCX_NPROC_RESULTS")
    environment = os.environ | dict.fromkeys(variables, str(cores))
    for suffix in (".sta", ".cvg", ".dat"):
        deck.with_suffix(suffix).unlink(missing_ok=True)
    command = ["ccx", "-i", deck.stem]
    started, cpu = time.perf_counter(), cpu_of_children()
    with open(deck.with_suffix(".log"), "w", encoding="utf-8") as log:
        try:
            subprocess.run(
                command, cwd=deck.parent, env=environment, stdout=log, stderr=log, timeout=timeout
            )
        except subprocess.TimeoutExpired:
            print(f"CalculiX was stopped after {timeout:.0f} s.")
    seconds, cpu = time.perf_counter() - started, cpu_of_children() - cpu
    rows = [row for row in rows_of(deck.with_suffix(".sta")) if not row[2].endswith("U")]
    output = text_of(deck.with_suffix(".dat"))
    total = r"total force .* set STIMULATOR .*\s+(\S+)\s+(\S+)\s+(\S+)"
    force, sed = np.array(re.findall(total, output), dtype=float), energies(output)
    finished = "Job finished" in text_of(deck.with_suffix(".log"))
    if not finished:
        sed = sed[:-1]  # it may have been cut off
    whole = min(len(rows), len(force), len(sed) if "energy density" in output else len(rows))
    return DeckRun(
        np.array([int(row[0]) - 1 for row in rows[:whole]], dtype=int),
        np.array([float(row[5]) for row in rows[:whole]]),
        force[:whole],
        sed[:whole],
        finished,
        len(rows_of(deck.with_suffix(".cvg"))),
        seconds,
        cpu,
    )


def energies(output: str) -> np.ndarray:
    """Return the mean SED (kPa) of the tetrahedra, (increments, highest number)."""
    found = []
    for block in re.split(r"internal energy density .*\n", output)[1:]:
        rows = re.findall(r"^ *(\d+) +[1-4] +(\S+E[+-]\d+) *$", block, re.MULTILINE)
        number, density = np.array(rows, dtype=float).T
        found.append(KPA_PER_MPA / 4 * np.bincount(number.astype(int) - 1, density))
    return np.array(found)


def cpu_of_children() -> float:
    """Return the CPU time, in s, of all processes that were started and have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def rows_of(path: Path) -> list[list[str]]:
    """Return the rows of a CalculiX table, without its heading."""
    return [line.split() for line in text_of(path).splitlines() if re.match(r"\s*\d", line)]


def text_of(path: Path) -> str:
    """Return a file's text; empty if CalculiX did not write it."""
    return path.read_text(encoding="utf-8") if path.exists() else ""


def is_installed() -> bool:
    """Return whether CalculiX is installed, and print a message if not."""
    found = shutil.which("ccx") is not None
    if not found:
        print("CalculiX is not installed: there is no ccx on the path, so nothing is run.")
    return found


# %%
def main(
    deck: Path,
    study: Path | None = None,
    /,
    *,
    changes: Annotated[tuple[str, ...], Parameter(name="--set")] = (),
    grid_mm: float = 0.1,
    cores: int = 1,
    timeout: float = 3600.0,
) -> None:
    """Write a study's deck, run it, and print the force on the finger at each increment."""
    the_study = load_study(study, changes)
    the_study.finger.require_solid("an input deck")
    finger = checked_mesh(the_study)
    size = write_deck(the_study, finger, deck, grid_mm=(grid_mm, grid_mm))
    print(f"{size.cells} tetrahedra, {size.unknowns} unknowns, {size.skin_facets} faces of skin")
    if not is_installed():
        return
    done = run_deck(deck, cores=cores, timeout=timeout)
    print("step  share  normal N  tangential N")
    for leg, share, force in zip(done.leg, done.share, done.force_N, strict=True):
        print(f"{leg + 1:4}  {share:5.3f}  {force[2]:8.5f}  {-force[1]:12.5f}")
    state = "finished" if done.finished else "not finished"
    print(f"{state}: {done.iterations} iterations, {done.seconds:.0f} s")


if __name__ == "__main__":
    run_script(main)
