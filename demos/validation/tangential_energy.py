# %% [markdown]
# # Where a pad that is pushed sideways stores the energy
#
# A flat plate is pressed to a normal force and then moves a little along the finger at that force,
# while all of the skin sticks. The energy stored in the elastic tissue (cell means of the strain
# energy density times the undeformed volumes) is split by where the tissue is: over the contact, or
# outside of it. Over the contact is what lies above the convex hull, in X and Y, of the skin that
# touches, from the skin to the bone, by the deformed centre of each element; the rest is outside.
#
# Predicted; nothing is fitted. About 70 % is reported for people (Doumont et al.).
#
#     python demos/validation/tangential_energy.py  # two forces: five minutes on one core
#     python demos/validation/tangential_energy.py --forces 0.05 --pad-size 3 --far-size 6

# %%
from contextlib import closing
from typing import Literal

import numpy as np
from scipy.spatial import Delaunay
from slip import TOUCHING_MM

from tactile_fem import FingerMesh, Simulation, Study, run_script
from tactile_fem.finger.mesh_data import SURFACES, TISSUES
from tactile_fem.simulation.cell_fields import CellFields
from tactile_fem.study import Finger, Plate, Press, Protocol, Receptors, Slide

STUCK_FRICTION = 3.0
SKIN = ("stratum_corneum", "epidermis", "dermis")


# %%
def main(
    forces: tuple[float, ...] = (1.0, 2.0),
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    distance: float = 1.0,
    speed: float = 2.0,
) -> None:
    """Push the pad sideways and print the share of the energy outside of the contact.

    Parameters
    ----------
    forces
        Normal forces, N.
    preset, pad_size, far_size
        The mesh.
    distance
        Displacement of the plate along the finger, mm.
    speed
        Speed of the plate, mm/s.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    for force in forces:
        pushed(finger, force, distance, speed)


def pushed(finger: Finger, force: float, distance: float, speed: float) -> None:
    """Press, push and print, for one normal force."""
    study = Study(
        finger=finger,
        stimulus=Plate(friction=STUCK_FRICTION),
        protocol=Protocol(
            path=(
                Press(force_N=force, speed_mm_s=speed),
                Slide(by_mm=(0.0, -distance), speed_mm_s=speed, force_N=force),
            )
        ),
        receptors=Receptors(spacing_mm=5.0),
    )
    seen, fields = {}, None
    with closing(Simulation(study)) as simulation:
        for step in simulation.steps():
            fields = fields or CellFields(simulation.problem)
            u = simulation.problem.order.gather(simulation.state.u)
            seen[step.phase] = step, u, fields.gather()["sed_kPa"]
        mesh = simulation.finger
    (_, _, before), (step, u, after) = seen["press"], seen["slide"]
    energy_mJ = volumes(mesh) / 1000
    outside = ~over_contact(mesh, u, step.stimulator_mm[2])
    skin = np.isin(mesh.tissue, [TISSUES[name] for name in SKIN])
    tangential = float(np.hypot(*step.load.force_N[:2]))
    print(f"{force:g} N, pushed by {distance:g} mm: {tangential:.2f} N along the finger")
    for what, sed in (("more than before the push", after - before), ("in all", after)):
        told = []
        for name, of in (("tissue", np.ones_like(skin)), ("skin", skin), ("fat", ~skin)):
            energy = energy_mJ * sed * of
            share = energy[outside].sum() / energy.sum()
            told.append(f"{name} {energy.sum():.3f} mJ, {100 * share:.0f} % outside")
        print(f"  {what}: {'; '.join(told)}")


def volumes(mesh: FingerMesh) -> np.ndarray:
    """Return the undeformed volumes of the elements, mm3."""
    corners = mesh.nodes[mesh.cells[:, :4]]
    return np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6


def over_contact(mesh: FingerMesh, u: np.ndarray, plate_mm: float) -> np.ndarray:
    """Return whether each element lies over the skin that touches."""
    place = mesh.nodes + u
    skin = np.unique(mesh.facets[mesh.surface == SURFACES["skin"]])
    touching = place[skin[place[skin, 2] - plate_mm < TOUCHING_MM]]
    centres = place[mesh.cells[:, :4]].mean(axis=1)
    return Delaunay(touching[:, :2]).find_simplex(centres[:, :2]) >= 0


if __name__ == "__main__":
    run_script(main)
