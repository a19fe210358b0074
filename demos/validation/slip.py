"""A plate that drags the skin: stiffness, and how slip spreads from the rim.

A flat plate is pressed to a normal force and slides along the finger at that force. Skin touches if
it is nearer to the plate than 0.01 mm. It sticks if it moved less than a tenth as far against the
plate as the plate moved in the last step; the share that sticks is by deformed area. The stiffness
is that of the first 0.2 mm.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from tactile_fem import FingerMesh, Simulation, Study
from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.study import Finger, Plate, Protocol, Receptors, Solver

TOUCHING_MM, STICKS, FIRST_MM = 0.01, 0.1, 0.2


@dataclass(frozen=True)
class Drag:
    """One step of the slide.

    Attributes
    ----------
    plate_mm, skin_mm
        How far the plate and the skin at the centre of the contact have moved.
    stuck, stuck_radius
        Share of the touching area that sticks; mean distance of the sticking skin from the centre
        of the contact, as a share of that of all touching skin, 1 if it is spread like it.
    """

    plate_mm: float
    skin_mm: float
    tangential_N: float
    stuck: float
    stuck_radius: float


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
            u = simulation.problem.order.gather(simulation.state.u)
            now = simulation.comm.bcast(u)
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
    distance = np.linalg.norm(centre - (touching @ centre) / touching.sum(), axis=1)
    apex = np.argmin(np.linalg.norm(mesh.nodes, axis=1))
    spread = (stuck @ distance / stuck.sum()) if stuck.sum() > 0 else 0.0
    return Drag(
        step.displacement_mm,
        float(abs((now - rest)[apex, 1])),
        float(np.hypot(*step.load.force_N[:2])),
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
