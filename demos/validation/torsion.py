# %% [markdown]
# # A plate that twists on the pad: slip from the rim, and the twist to full slip
#
# A flat plate is pressed to a force and turns about Z at it (as in du Bois de Dunilac et al. 2023).
# Skin slips if, in the last step, it moved more than a tenth as far against the plate as the plate
# did there; its share is by area. The torque of sliding is the sum of nodal pressure, coefficient
# and distance from the axis multiplied. Slip is full at 95 % of the area and of this torque.
# Predicted; nothing is fitted.
#
#     python demos/validation/torsion.py results/torsion  # three forces: three minutes on one core
#     python demos/validation/torsion.py results/quick --forces 0.05 --pad-size 3 --far-size 6

# %%
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure
from slip import STICKS

from tactile_fem import FingerMesh, Simulation, Study, run_script, write_table
from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.path.rotations import matrix
from tactile_fem.runtime.ranks import on_root
from tactile_fem.study import Finger, Plate, Press, Protocol, Receptors, Twist

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

FULL, PRESSES = 0.95, 0.01


@dataclass(frozen=True)
class Turned:
    """One step of a twist: share of skin that slips, mean distances from the axis, and others."""

    force_N: float
    angle_deg: float
    torque_Nmm: float
    newton_iterations: int
    sliding_Nmm: float
    slips: float
    slipping_mm: float
    sticking_mm: float


def main(
    folder: Path,
    *,
    forces: tuple[float, ...] = (0.25, 0.5, 1.0),
    friction: float = 0.3,
    angle: float = 40.0,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Press, twist to full slip, print and draw.

    Parameters
    ----------
    folder, forces
        Folder for table and figure; normal forces, N.
    friction, angle
        Coefficient between plate and skin; largest twist, degrees.
    preset, pad_size, far_size
        The mesh.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    found: list[Turned] = []
    for twist in (Twist(angle_deg=angle, force_N=force) for force in forces):
        found += twisted(finger, friction, twist)
        on_root(MPI.COMM_WORLD, lambda: report(folder, found))


def twisted(finger: Finger, friction: float, twist: Twist) -> Iterator[Turned]:
    """Press to the twist's normal force and yield each step up to full slip, on every rank."""
    plate, few = Plate(friction=friction), Receptors(spacing_mm=5.0)
    path = Protocol(path=(Press(force_N=twist.force_N), twist))
    study = Study(finger=finger, stimulus=plate, protocol=path, receptors=few)
    with closing(Simulation(study)) as simulation:
        order, before, turned = simulation.problem.order, None, np.zeros(3)
        for step in simulation.steps():
            now, bound = order.gather(simulation.state.u), order.gather_owned(step.load.bound_N)
            if step.phase == "twist":
                felt = simulation.finger, before, now, bound, step.stimulator_rad - turned
                slip = on_root(simulation.comm, lambda felt=felt: slip_of(*felt))
                angle, cost = float(np.degrees(step.stimulator_rad[2])), step.newton_iterations
                yield (seen := Turned(twist.force_N, angle, step.torque_Nmm, cost, *slip))
                if seen.slips >= FULL and seen.torque_Nmm >= FULL * seen.sliding_Nmm:
                    return
            before, turned = now, step.stimulator_rad


def slip_of(
    mesh: FingerMesh, before: np.ndarray, now: np.ndarray, bound: np.ndarray, turn: np.ndarray
) -> tuple[float, float, float, float]:
    """Return the last four of `Turned`; each middle of an edge represents a third of its facets."""
    facets = mesh.facets[mesh.surface == SURFACES["skin"]]
    old, place = mesh.nodes + before, mesh.nodes + now
    first, second, third = (place[facets[:, k]] for k in range(3))
    thirds = np.linalg.norm(np.cross(second - first, third - first), axis=1).repeat(3) / 6
    area = np.bincount(facets[:, 3:].ravel(), thirds, minlength=len(place))
    distance, plate = np.hypot(*place[:, :2].T), old @ matrix(turn).T
    slid, moved = (np.hypot(*(plate - of)[:, :2].T) for of in (place, old))
    touching = area * (bound[:, 2] > PRESSES * bound[area > 0, 2].max())
    slipping = touching * (slid > STICKS * moved)
    means = (of @ distance / max(of.sum(), 1e-9) for of in (slipping, touching - slipping))
    return tuple(map(float, (bound[:, 2] @ distance, slipping.sum() / touching.sum(), *means)))


def report(folder: Path, found: list[Turned]) -> None:
    """Print the twist at the last force, and when slip is full; write and draw all."""
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "torsion.csv", found)
    draw(folder / "torsion.png", found)
    steps = [step for step in found if step.force_N == found[-1].force_N]
    print(*vars(steps[0]))
    for step in steps:
        print(*(f"{value:.3g}" for value in vars(step).values()))
    rows = np.array([[s.angle_deg, s.slips, s.torque_Nmm / s.sliding_Nmm] for s in steps])
    for name, share in zip(("area", "torque"), rows.T[1:], strict=True):
        at = np.interp(FULL, np.maximum.accumulate(share), rows[:, 0], right=np.nan)
        print(f"{steps[0].force_N:g} N: {FULL:.0%} of the {name} at {at:.1f} degrees")


def draw(picture: Path, found: list[Turned]) -> None:
    """Draw torque and share of slip over the twist, a line for each force."""
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for force, group in groupby(found, lambda step: step.force_N):
        rows = [(step.angle_deg, step.torque_Nmm, step.sliding_Nmm, step.slips) for step in group]
        angle, torque, sliding, slips = np.transpose(rows)
        (line,) = left.plot([0, *angle], [0, *torque])
        left.plot(angle, sliding, "--", color=line.get_color(), lw=0.8)
        right.plot(angle, slips, label=f"{force:g} N")
    left.set_ylabel("Torque, dashed: of sliding (Nmm)")
    right.set_ylabel("Share of the contact that slips")
    right.legend(frameon=False)
    for axes in (left, right):
        axes.set(xlabel="Twist (degrees)", xlim=(0, None), ylim=(0, None))
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    run_script(main)
