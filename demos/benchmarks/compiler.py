# %% [markdown]
# # Effects of the compiler's flags
#
# DOLFINx compiles each form to C. This benchmark emphasizes
# - the speed-up of assembly by flags that depend on the processor or reorder sums,
# - their effect on the results.
#
# All variants assemble the same state of the same finger in turns, so that changes in the
# machine's speed affect all of them.
#
#     python demos/benchmarks/compiler.py compiler

# %%
import logging
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_fem import Simulation, Study, run_script, write_table
from tactile_fem.runtime.logs import set_up
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Finger, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

VARIANTS = {
    "O2": ("-O2",),
    "O3": ("-O3",),
    "native": ("-O3", "-march=native"),
    "reordered": ("-O3", "-ffast-math", "-fno-finite-math-only"),
    "both": ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only"),
}
DEPTH_MM = 0.3


# %%
@dataclass(frozen=True)
class Row:
    """Median seconds of one variant's assembly, and its difference from the first variant.

    Attributes
    ----------
    ready_s
        Until the forms were compiled, or found in the cache.
    residual_error, displacement_error
        Relative to the largest entry.
    """

    variant: str
    ready_s: float
    jacobian_s: float
    residual_s: float
    residual_error: float
    displacement_error: float


def main(
    folder: Path,
    *,
    rounds: int = 7,
    variants: list[str] | None = None,
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Assemble `rounds` times with each variant; print and save the table.

    Parameters
    ----------
    folder
        Where `compiler.csv` goes.
    rounds
        Turns of all variants; the median of each counts.
    variants
        Names of those wanted; default all. The first is the reference.
    pad_size, far_size
        Edges of the mesh in mm; default the coarse finger's.
    """
    set_up(level=logging.ERROR)
    finger = Finger(pad_size_mm=pad_size, far_size_mm=far_size)
    names = variants or list(VARIANTS)
    problems, ready_s = {}, {}
    for name in names:
        started = time.perf_counter()
        solver = Solver(compiler_flags=VARIANTS[name], linear="direct")
        simulation = Simulation(Study(finger=finger, solver=solver), comm=MPI.COMM_SELF)
        problems[name] = simulation.problem
        ready_s[name] = time.perf_counter() - started
    pressed = {name: press(problem) for name, problem in problems.items()}
    state = pressed[names[0]]
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    residuals = {}
    for _ in range(rounds):
        for name, problem in problems.items():
            *times, residuals[name] = assemble(problem, state)
            seconds[name].append(times)
    rows = [
        Row(
            name,
            ready_s[name],
            *np.median(seconds[name], axis=0).tolist(),
            relative_difference(residuals[name], residuals[names[0]]),
            relative_difference(pressed[name], state),
        )
        for name in names
    ]
    print("variant     ready s  Jacobian s  residual s  residual error  displacement error")
    for row in rows:
        print(
            f"{row.variant:<10} {row.ready_s:8.1f} {row.jacobian_s:11.4f} {row.residual_s:11.4f} "
            f"{row.residual_error:15.1e} {row.displacement_error:19.1e}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "compiler.csv", rows)


def press(problem: FingerProblem) -> np.ndarray:
    """Press the letters in and return the displacement."""
    for depth in (0.1, 0.2, DEPTH_MM):
        assert problem.solve(np.array([0.0, -2.0, depth]), 0.005).converged
        problem.accept()
    return problem.u.x.array.copy()


def assemble(problem: FingerProblem, state: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Return seconds of the Jacobian and of the residual at a state, and that residual."""
    snes = problem.solver.snes
    x, b = snes.getSolution(), snes.getFunction()[0]
    x.array = state[: x.getLocalSize()]
    started = time.perf_counter()
    snes.computeFunction(x, b)
    middle = time.perf_counter()
    snes.computeJacobian(x, snes.getJacobian()[0])
    return time.perf_counter() - middle, middle - started, b.array.copy()


def relative_difference(values: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest difference relative to the largest value."""
    return float(np.abs(values - reference).max() / np.abs(reference).max())


# %%
if __name__ == "__main__":
    run_script(main)
