# %% [markdown]
# # The letters' force at the paper's depth, and the depth of the paper's force
#
# This demo emphasizes
# - both values from one press: a step at the exact depth, interpolation for the force,
# - a prediction: the letters are not in the data that the tissue was fitted to.
#
# Hamasaki et al. 2020 press F G H 1.97 mm deep, "which corresponds to 0.6 N". The accepted error
# is 15 %.
#
#     python demos/validation/letters_force.py results/letters
#     python demos/validation/letters_force.py results/slowly --press-speed 0.2
#     python demos/validation/letters_force.py results/letters --preset medium
#     python demos/validation/letters_force.py results/letters --depth 0.3

# %%
from pathlib import Path
from typing import Literal

import numpy as np
from flat_plate import BLUE, ORANGE, State, plate_study
from matplotlib.figure import Figure

from tactile_fem import ConvergenceError, run_script, scan, write_table
from tactile_fem.simulation.stepper import Step
from tactile_fem.study import Protocol, Text

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

DEPTH_MM, FORCE_N, GATE = 1.97, 0.6, 0.15
STEP_MM = DEPTH_MM / 20


def state_of(step: Step) -> State:
    """Return the state at the end of a step."""
    normal_N = float(step.force_N[2])
    return State(step.depth_mm, normal_N, step.contact_area_mm2, step.volume_change)


# %% [markdown]
# If the press ends before its final depth, the results so far are printed.


# %%
def main(
    folder: Path,
    *,
    depth: float = 22 * STEP_MM,
    press_speed: float = 20.0,
    tissue: str = "fitted",
    preset: Literal["coarse", "medium", "paper"] = "coarse",
) -> None:
    """Press the letters to at most `depth` mm; print force at 1.97 mm and depth at 0.6 N.

    The speed (mm/s) counts by the viscosity: at 0.2 mm/s nearly nothing.
    """
    protocol = Protocol(depth_mm=depth, distance_mm=0.0, press_speed_mm_s=press_speed)
    study = plate_study(depth, STEP_MM, {"set": tissue}, preset).model_copy(
        update={"stimulus": Text(), "protocol": protocol}
    )
    states = [State(0.0, 0.0, 0.0, 0.0)]
    try:
        scan(study, observers=[lambda seen: states.append(state_of(seen.step))])
    except ConvergenceError as error:
        if len(states) == 1:
            raise
        if MPI.COMM_WORLD.rank == 0:
            print(error)
    if MPI.COMM_WORLD.rank:
        return
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "letters_force.csv", states)
    print_results(states)
    draw(states, folder / "letters_force.png")


# %%
def print_results(states: list[State]) -> None:
    """Print force at the paper's depth and depth at the paper's force, if they were reached."""
    depth = np.array([state.depth_mm for state in states])
    force = np.array([state.force_N for state in states])
    last = states[-1]
    print(f"at {last.depth_mm:.3f} mm: {last.force_N:.4f} N on {last.contact_area_mm2:.1f} mm²")
    if depth[-1] >= DEPTH_MM - 1e-9:
        model = np.interp(DEPTH_MM, depth, force)
        deviation = model / FORCE_N - 1
        verdict = "within" if abs(deviation) <= GATE else "outside"
        print(
            f"force at {DEPTH_MM} mm {model:.4f} N: {deviation:+.1%}, "
            f"{verdict} {GATE:.0%} of {FORCE_N}"
        )
    if force[-1] >= FORCE_N:
        print(f"depth at {FORCE_N} N {np.interp(FORCE_N, force, depth):.3f} mm")
    else:
        print(f"{FORCE_N} N is not reached at {depth[-1]:.3f} mm")


# %%
def draw(states: list[State], picture: Path) -> None:
    """Draw force over depth with the paper's value and the accepted error."""
    figure = Figure(figsize=(4.5, 3.3), layout="constrained")
    axes = figure.add_subplot()
    depth, force = [state.depth_mm for state in states], [state.force_N for state in states]
    axes.plot(depth, force, color=BLUE, label="model, letters F G H")
    point = {"fmt": "o", "capsize": 3, "color": ORANGE, "label": "Hamasaki et al. 2020, ± 15 %"}
    axes.errorbar(DEPTH_MM, FORCE_N, GATE * FORCE_N, **point)
    axes.set(xlabel="Indentation (mm)", ylabel="Normal force (N)", ylim=(0, None))
    axes.legend(frameon=False, loc="upper left")
    figure.savefig(picture, dpi=150)


# %%
if __name__ == "__main__":
    run_script(main)
