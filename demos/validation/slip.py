# %% [markdown]
# # A plate that drags the skin: stiffness, and how slip spreads from the rim
#
# This demo emphasizes
# - the tangential stiffness of the pad over the normal force,
# - which part of the contact sticks while the tangential force grows,
# - how far the skin is dragged before all of it slips.
#
# A flat plate is pressed to a normal force and slides along the finger at that force. Skin touches
# if it is nearer to the plate than 0.01 mm. It sticks if it moved less than a tenth as far against
# the plate as the plate moved in the last step; the share that sticks is by deformed area. The
# stiffness is that of the first 0.2 mm.
#
# Measured: tangential stiffness grows linearly with the normal force (Pataky et al. 2005); slip
# begins at the rim of the contact and closes on a stuck centre (Delhaye et al. 2014, Barrea et al.
# 2018); below 0.5 N skin is dragged 3.4 mm (0.9 to 6.3) by a flat plate before all of it slips
# (Corniani et al. 2025, eLife 93554). The coefficient of friction in that experiment is not known:
# dry or wet smooth plates have 0.5 to 1.1, nylon 0.3.
#
#     python demos/validation/slip.py results/slip
#     python demos/validation/slip.py results/slip --friction 0.3 --force 0.1

# %%
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from tactile_fem import FingerMesh, Simulation, Study, run_script, write_table
from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.runtime.estimates import r_squared
from tactile_fem.study import Finger, Plate, Protocol, Receptors, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

TOUCHING_MM, STICKS, FIRST_MM = 0.01, 0.1, 0.2
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"


@dataclass(frozen=True)
class Drag:
    """One step of the slide.

    Attributes
    ----------
    plate_mm
        How far the plate has moved.
    skin_mm
        How far the skin at the centre of the contact has moved.
    stuck, stuck_radius
        Share of the touching area that sticks; mean distance of the sticking skin from the centre
        of the contact, as a share of that of all touching skin, 1 if it is spread like it.
    """

    plate_mm: float
    skin_mm: float
    normal_N: float
    tangential_N: float
    stuck: float
    stuck_radius: float


# %%
def main(
    folder: Path,
    *,
    force: float = 0.4,
    friction: float = 0.8,
    distance: float = 6.0,
    stiffness_forces: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0),
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Drag a plate; print stiffness, stuck share and the way to full slip; N and mm."""
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    steps = list(drag(finger, force, friction, distance))
    stiffness = [
        (normal, tangential_stiffness(finger, normal, friction)) for normal in stiffness_forces
    ]
    if MPI.COMM_WORLD.rank:
        return
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "slip.csv", steps)
    print_results(steps, stiffness)
    draw(steps, stiffness, folder / "slip.png")


# %%
def drag(finger: Finger, force: float, friction: float, distance: float) -> Iterator[Drag]:
    """Press a plate to a force, slide it and yield each step of the slide, on every rank."""
    study = Study(
        finger=finger,
        stimulus=Plate(friction=friction),
        protocol=Protocol(
            force_N=force,
            press_speed_mm_s=0.2,
            hold="force",
            distance_mm=distance,
            speed_mm_s=0.8,
        ),
        receptors=Receptors(spacing_mm=5.0),
        solver=Solver(max_press_step_mm=0.25),
    )
    mesh = finger.mesh()
    with closing(Simulation(study)) as simulation:
        rest = before = None
        for step in simulation.steps():
            now = simulation.problem.order.gather(simulation.state.u)
            if step.phase == "press":
                rest = now
            else:
                moved = step.stimulator_mm - simulation.state.translation_before
                yield _observed(mesh, now, before, rest, moved, step)
            before = now


def _observed(mesh: FingerMesh, now, before, rest, moved, step) -> Drag:
    triangles = mesh.facets[mesh.surface == SURFACES["skin"], :3]
    place = mesh.nodes + now
    touches = place[:, 2] - step.stimulator_mm[2] < TOUCHING_MM
    slid = np.linalg.norm((now - before - moved)[:, :2], axis=1)
    sticks = touches & (slid < STICKS * np.hypot(moved[0], moved[1]))
    first, second, third = (place[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1) / 2
    centre = (first + second + third)[:, :2] / 3
    touching = area * touches[triangles].mean(axis=1)
    stuck = area * sticks[triangles].mean(axis=1)
    middle = (touching @ centre) / touching.sum()
    distance = np.linalg.norm(centre - middle, axis=1)
    apex = np.argmin(np.linalg.norm(mesh.nodes, axis=1))
    spread = (stuck @ distance / stuck.sum()) if stuck.sum() > 0 else 0.0
    return Drag(
        step.displacement_mm,
        float(abs((now - rest)[apex, 1])),
        float(step.force_N[2]),
        float(np.hypot(step.force_N[0], step.force_N[1])),
        float(stuck.sum() / touching.sum()),
        float(spread / (touching @ distance / touching.sum())),
    )


def tangential_stiffness(finger: Finger, normal: float, friction: float) -> float:
    """Return the tangential force over the first 0.2 mm of the slide, N/mm."""
    *_, last = drag(finger, normal, friction, FIRST_MM)
    return last.tangential_N / last.plate_mm


def full_slip(steps: list[Drag]) -> Drag | None:
    """Return the first step in which no skin sticks any more, to two percent of the area."""
    return next((step for step in steps if step.stuck < 0.02), None)


# %%
def print_results(steps: list[Drag], stiffness: list[tuple[float, float]]) -> None:
    """Print stiffness over normal force, the stuck share, and the way to full slip."""
    print("normal N  stiffness N/mm")
    for normal, value in stiffness:
        print(f"{normal:8.2f}  {value:8.3f}")
    normal, value = np.array(stiffness).T
    if len(normal) > 1:
        slope, offset = np.polyfit(normal, value, 1)
        line = r_squared(offset + slope * normal, value)
        print(f"stiffness = {offset:.3f} + {slope:.3f} N/mm per N, R2 {line:.4f}")
    print("plate mm  skin mm  tangential N  stuck  its radius")
    for step in steps:
        print(
            f"{step.plate_mm:8.3f} {step.skin_mm:8.3f} {step.tangential_N:13.4f} "
            f"{step.stuck:6.2f} {step.stuck_radius:8.2f}"
        )
    end = full_slip(steps)
    if end is None:
        print(f"not all skin slips within {steps[-1].plate_mm:.2f} mm")
    else:
        print(f"all skin slips after the skin was dragged {end.skin_mm:.2f} mm")


# %%
def draw(steps: list[Drag], stiffness: list[tuple[float, float]], picture: Path) -> None:
    """Draw the stuck share over the tangential force, the forces and the stiffness."""
    figure = Figure(figsize=(10, 3.3), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    tangential = [step.tangential_N for step in steps]
    left.plot(tangential, [step.stuck for step in steps], color=BLUE, marker=".")
    left.set(xlabel="Tangential force (N)", ylabel="Share of the contact that sticks", ylim=(0, 1))
    middle.plot([step.plate_mm for step in steps], tangential, color=BLUE, label="force (N)")
    middle.plot(
        [step.plate_mm for step in steps],
        [step.skin_mm for step in steps],
        color=GREEN,
        label="drag of the central skin (mm)",
    )
    middle.set(xlabel="Displacement of the plate (mm)", ylim=(0, None))
    middle.legend(frameon=False)
    right.plot(*np.array(stiffness).T, color=ORANGE, marker="o")
    right.set(
        xlabel="Normal force (N)",
        ylabel="Tangential stiffness (N/mm)",
        xlim=(0, None),
        ylim=(0, None),
    )
    figure.savefig(picture, dpi=150)


# %%
if __name__ == "__main__":
    run_script(main)
