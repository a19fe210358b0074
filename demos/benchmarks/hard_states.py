# %% [markdown]
# # Nonlinear solvers on difficult states
#
# This benchmark emphasizes
# - the difficult states for Newton's method: first touch, the deep press, the start of the slide,
#   a letter's edge that arrives or leaves,
# - how PETSc's line searches and trust regions compare on exactly the same saved states.
#
# A simulation is run once, and its state at each of these moments is saved. Each strategy then
# takes the same few steps from each state; failed steps are halved and counted.
#
#     python demos/benchmarks/hard_states.py states
#     python demos/benchmarks/hard_states.py states --friction 1 --fillet 0.1
#
# A strategy is a set of PETSc options over the package's defaults, and a contact width in MPa.

# %%
import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from tactile_fem import (
    ConvergenceError,
    Simulation,
    Study,
    StudyError,
    load_study,
    run_script,
    write_table,
)
from tactile_fem.runtime.logs import set_up
from tactile_fem.runtime.ranks import on_root
from tactile_fem.study import Finger, Solver, Text
from tactile_fem.study.file import dump_study

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)


# %%
@dataclass(frozen=True)
class Strategy:
    """PETSc options that override the defaults, and the contact width."""

    name: str
    petsc: dict[str, str | int | float] = field(default_factory=dict)
    width_MPa: float = Solver().contact_width_MPa


def line_search(name: str, **more: str | int | float) -> dict[str, str | int | float]:
    """Return the options of a line search without the package's lower bound of its step."""
    return {"snes_linesearch_type": name, "snes_linesearch_minlambda": 1e-12, **more}


# One Newton step as the preconditioner of an accelerated iteration; it solves with MUMPS.
NEWTON_STEP: dict[str, str | int | float] = {
    "npc_snes_type": "newtonls",
    "npc_snes_max_it": 1,
    "npc_snes_linesearch_type": "bt",
    "npc_snes_linesearch_order": 1,
    "npc_ksp_type": "preonly",
    "npc_pc_type": "lu",
    "npc_pc_factor_mat_solver_type": "mumps",
    "npc_snes_convergence_test": "skip",
    "snes_max_it": 40,
}

STRATEGIES = (
    Strategy("default"),
    Strategy("kink (no width)", width_MPa=0.0),
    Strategy("kink, any short step", {"snes_linesearch_minlambda": 1e-12}, 0.0),
    Strategy("bt, cubic", line_search("bt", snes_linesearch_order=3)),
    Strategy("cp", line_search("cp")),
    Strategy("secant (l2)", line_search("secant")),
    Strategy("nleqerr", line_search("nleqerr")),
    Strategy("full steps", line_search("basic")),
    Strategy("trust region", {"snes_type": "newtontr"}),
    Strategy("trust region, dogleg", {"snes_type": "newtontrdc"}),
    Strategy("NGMRES around Newton", {"snes_type": "ngmres", **NEWTON_STEP}),
    Strategy("Anderson around Newton", {"snes_type": "anderson", **NEWTON_STEP}),
    Strategy("exact linear solves", {"snes_ksp_ew_rtol0": 1e-3, "snes_ksp_ew_rtolmax": 1e-3}),
)

# Moments of the scan: name, depth and slide, in mm, that the state has just reached.
MOMENTS = {
    "first touch": (0.04, 0.0),
    "deep press": (1.2, 0.0),
    "slide start": (1.97, 0.0),
    "edge arrives": (1.97, 3.0),
    "edge leaves": (1.97, 7.8),
}


@dataclass(frozen=True)
class Outcome:
    """Result of a strategy from one state."""

    strategy: str
    moment: str
    steps: int
    failures: int
    newton: int
    linear: int
    seconds: float
    advance_s: float


# %%
def main(
    folder: Path,
    *,
    preset: str = "coarse",
    friction: float = 0.3,
    fillet: float = 0.3,
    steps: int = 4,
    moments: list[str] | None = None,
    strategies: list[str] | None = None,
) -> None:
    """Save the states, replay them with each strategy, print and save the table.

    Parameters
    ----------
    folder
        Where states and `strategies.csv` go; states that are there are used again.
    preset, friction, fillet
        Mesh, Coulomb's coefficient, radius of the letters' top edge in mm.
    steps
        Accepted steps from each state.
    moments, strategies
        Names of those wanted; default all.
    """
    set_up(level=logging.ERROR)
    study = Study(
        finger=Finger(preset=preset),
        stimulus=Text(friction=friction, fillet_radius_mm=fillet),
    )
    outcomes = []
    states = saved_states(study, folder, moments or list(MOMENTS))
    for strategy in STRATEGIES:
        if strategies and strategy.name not in strategies:
            continue
        for outcome in replay(study, strategy, states, steps):
            outcomes.append(outcome)
            print_results(outcome, heading=len(outcomes) == 1)
    if MPI.COMM_WORLD.rank == 0:
        write_table(folder / "strategies.csv", outcomes)


# %% [markdown]
# `gather` returns all that the next step needs.


# %%
def saved_states(study: Study, folder: Path, moments: list[str]) -> dict[str, Mapping]:
    """Return the state at each moment; run the simulation as far as one is missing."""
    comm = MPI.COMM_WORLD
    files = {name: folder / f"{name.replace(' ', '-')}.npz" for name in moments}
    on_root(comm, lambda: check_folder(study, folder))
    missing = on_root(comm, lambda: [name for name in moments if not files[name].exists()])
    if missing:
        with closing(Simulation(study)) as simulation:
            for step in simulation.steps():
                for name in missing[:]:
                    depth, slide = MOMENTS[name]
                    if step.depth_mm > depth - 1e-9 and step.displacement_mm > slide - 1e-9:
                        missing.remove(name)
                        state = simulation.gather()
                        on_root(comm, lambda at=files[name], of=state: np.savez(at, **of))
                if not missing:
                    break
    return {name: on_root(comm, lambda at=file: dict(np.load(at))) for name, file in files.items()}


def check_folder(study: Study, folder: Path) -> None:
    """Raise StudyError if the folder has states of another study."""
    file = folder / "study.toml"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        file.write_text(dump_study(study))
    elif load_study(file) != study:
        raise StudyError(f"{folder} holds states of another study: choose another folder.")


# %%
def replay(
    study: Study, strategy: Strategy, states: Mapping[str, Mapping], steps: int
) -> Iterator[Outcome]:
    """Take `steps` steps from each state."""
    solver = Solver(petsc=strategy.petsc, contact_width_MPa=strategy.width_MPa)
    with closing(Simulation(study.model_copy(update={"solver": solver}))) as simulation:
        for name, state in states.items():
            simulation.restore(state)
            started = time.perf_counter()
            taken = []
            try:
                for step in simulation.steps():
                    taken.append(step)
                    if len(taken) == steps:
                        break
            except ConvergenceError:
                pass  # its steps are missing in the table
            yield Outcome(
                strategy.name,
                name,
                len(taken),
                sum(not solve.converged for step in taken for solve in step.discarded),
                sum(step.newton_iterations for step in taken),
                sum(step.linear_iterations for step in taken),
                time.perf_counter() - started,
                sum(step.dt_s for step in taken),
            )


def print_results(outcome: Outcome, heading: bool) -> None:
    """Print a row of the table on the first rank."""
    if MPI.COMM_WORLD.rank:
        return
    row = asdict(outcome)
    if heading:
        print("".join(f"{name:>22}" if i < 2 else f"{name:>11}" for i, name in enumerate(row)))
    values = [f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()]
    print("".join(f"{v:>22}" if i < 2 else f"{v:>11}" for i, v in enumerate(values)), flush=True)


# %%
if __name__ == "__main__":
    run_script(main)
