# %% [markdown]
# # Cattaneo and Mindlin: a pressed ball that begins to slide
#
# A ball pressed with $P$ has Hertz's pressure $p$ on a disc of radius $a$. Under a tangential force
# $Q < \mu P$ a disc of radius $c$ sticks, with the friction $q$:
#
# $$ c/a = (1 - Q/\mu P)^{1/3}, \qquad
#    q(r) = \mu p_0 \left(\sqrt{1 - r^2/a^2} - \tfrac{c}{a} \sqrt{1 - r^2/c^2}\right). $$
#
# The stick radius is measured without a threshold: the second moment of the friction is
# $\int q\, r^2 dA = \mu (1 - c^5/a^5) \int p\, r^2 dA$. The ball moves to, fro and to again, and in
# each step its work is compared with heat and stored energy.
#
#     python demos/verification/partial_slip.py results/partial_slip
#     python demos/verification/partial_slip.py results/partial_slip --per-radius 5 --steps 6

# %%
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from hertz import COMM, R_MM, TISSUE, body_mesh, hertz_radius, symmetry
from skin_points import SkinPoints, SkinProbe

from tactile_fem import ConvergenceError, FingerMesh, run_script, write_table
from tactile_fem.finger.simplex import quadratic
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.load import Load
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Solver, Sphere

BODY_MM, FRICTION = 20.0, 0.3
PRESS_STEPS, RINGS = 6, 20


@dataclass(frozen=True)
class Row:
    """One step of the tangential load; forces are on the ball's whole contact.

    `share` is Q over mu P. `stick_by_force` and `stick_by_moment` are stick over contact radius on
    the first loading, NaN later. `balance` is work less heat less gain of stored energy, as a share
    of the largest work of a step.
    """

    leg: str
    slide_mm: float
    normal_N: float
    share: float
    stick_by_force: float
    stick_by_moment: float
    work_mJ: float
    friction_mJ: float
    stored_mJ: float
    balance: float


def with_mirror_image(quarter: FingerMesh) -> FingerMesh:
    """Return the mesh and its mirror image at y = 0: the load breaks this symmetry."""
    corners, cells = np.unique(quarter.cells[:, :4], return_inverse=True)
    nodes = quarter.nodes[corners]
    cells = cells.reshape(-1, 4)
    triangles = np.searchsorted(corners, quarter.facets[:, :3])
    shared = np.abs(nodes[:, 1]) < 1e-7
    image = np.arange(len(nodes))
    image[~shared] = len(nodes) + np.arange(np.count_nonzero(~shared))
    all_nodes, tets, sides = quadratic(
        np.concatenate([nodes, nodes[~shared] * [1, -1, 1]]),
        np.concatenate([cells, image[cells][:, [0, 2, 1, 3]]]),
        np.concatenate([triangles, image[triangles]]),
    )
    twice = np.tile(quarter.tissue, 2), sides, np.tile(quarter.surface, 2)
    return FingerMesh(all_nodes, tets, *twice)


# %%
@dataclass(frozen=True)
class State:
    """Load and skin after a step."""

    leg: str
    slide_mm: float
    load: Load
    points: SkinPoints | None


def stroke(per_radius: float, furthest_mm: float, steps: int) -> list[State]:
    """Press the ball, then move it to `furthest_mm`, to minus that and back again."""
    solver = Solver(held=("cut",), linear="direct", contact_width_MPa=1e-5)
    mesh = with_mirror_image(body_mesh("ball", per_radius, BODY_MM)) if COMM.rank == 0 else None
    domain = create_domain(mesh, COMM, solver.held)
    mirror_x = symmetry("ball", axes=(0,))
    body = Sphere(radius_mm=R_MM).body()
    problem = FingerProblem(domain, TISSUE, body, FRICTION, solver, mirror_x)
    probe, depth = SkinProbe(problem), 1 / R_MM
    way = [("press", 0.0, depth * k / PRESS_STEPS) for k in range(1, PRESS_STEPS + 1)]
    for leg, start, end, count in (
        ("to", 0.0, 1.0, steps),
        ("fro", 1.0, -1.0, 2 * steps),
        ("to again", -1.0, 1.0, 2 * steps),
    ):
        shares = np.linspace(start, end, count + 1)[1:]
        way += [(leg, share * furthest_mm, depth) for share in shares.tolist()]
    states = []
    for leg, slide, height in way:
        report = problem.solve(np.array([0.0, slide, height]), 1.0)
        if not report.converged:
            what = f"{leg} at {slide:g} mm: {report.reason}"
            raise ConvergenceError(what, (0.0, slide, height), report.reason)
        states.append(State(leg, slide, problem.load(), probe()))
        problem.accept(states[-1].load)
    return states


# %%
def rows_of(states: list[State]) -> list[Row]:
    """Return the table of the tangential load."""
    rows = []
    largest = max(abs(s.load.work_mJ) for s in states if s.leg != "press")
    for before, state in pairwise(states):
        if state.leg == "press":
            continue
        load, points = state.load, state.points
        normal = 2 * load.force_N[2]
        share = load.force_N[1] / (FRICTION * load.force_N[2])
        by_force = by_moment = math.nan
        if state.leg == "to":
            by_force = (1 - share) ** (1 / 3)
            r2 = radius(state) ** 2 * points.area_mm2
            ratio = (points.friction_MPa[:, 1] @ r2) / (FRICTION * points.pressure_MPa @ r2)
            by_moment = (1 - ratio) ** (1 / 5)
        energies = load.work_mJ, load.friction_mJ, load.stored_mJ - before.load.stored_mJ
        balance = (energies[0] - energies[1] - energies[2]) / largest
        sticks = share, by_force, by_moment
        rows.append(Row(state.leg, state.slide_mm, normal, *sticks, *energies, balance))
    return rows


def radius(state: State) -> np.ndarray:
    """Return the distance of the skin's points from the axis of the ball, (n,)."""
    x, y, _ = state.points.deformed_mm.T
    return np.hypot(x, y - state.slide_mm)


def profile_error(state: State) -> float:
    """Return the rms distance of the friction from Cattaneo's over mu p0, in means over rings."""
    r, load = radius(state), state.load
    normal = 2 * load.force_N[2]
    a = hertz_radius(normal)
    c = a * (1 - load.force_N[1] / (FRICTION * load.force_N[2])) ** (1 / 3)
    expected = np.sqrt(np.maximum(1 - (r / a) ** 2, 0))
    expected -= c / a * np.sqrt(np.maximum(1 - (r / c) ** 2, 0))
    found = state.points.friction_MPa[:, 1] / (FRICTION * 1.5 * normal / (math.pi * a**2))
    ring = np.minimum((r / a * RINGS).astype(int), RINGS)
    area = np.bincount(ring, state.points.area_mm2, RINGS + 1)[:RINGS]
    off = np.bincount(ring, state.points.area_mm2 * (found - expected), RINGS + 1)[:RINGS]
    return float(np.sqrt((off**2 / area).sum() / area.sum()))


# %%
def main(
    folder: Path, *, per_radius: float = 8.0, furthest: float = 0.012, steps: int = 12
) -> None:
    """Press and stroke the ball; print and save the table.

    Parameters
    ----------
    folder
        Folder for the table.
    per_radius
        Elements per contact radius.
    furthest
        Displacement at which the ball reverses, in mm; beyond 0.022 all skin slips.
    steps
        Steps from the middle to there.
    """
    states = stroke(per_radius, furthest, steps)
    if COMM.rank:
        return
    rows = rows_of(states)
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "partial_slip.csv", rows)
    loaded = [row for row in rows if row.leg == "to"]
    worst = max(abs(row.stick_by_moment / row.stick_by_force - 1) for row in loaded)
    turned = next(s for s in reversed(states) if s.leg == "to")
    loop = [row for row in rows if row.leg != "to"]
    heat, work = sum(row.friction_mJ for row in loop), sum(row.work_mJ for row in loop)
    print(f"stick radius: largest error {worst:.2%}")
    print(
        f"friction profile at Q/(mu P) = {loaded[-1].share:.2f}: error {profile_error(turned):.2%}"
    )
    print(f"energy balance: largest error of a step {max(abs(r.balance) for r in rows):.1e}")
    print(f"closed loop: heat {heat:.4e} mJ, work {work:.4e} mJ, {heat / work - 1:+.2%}")


# %%
if __name__ == "__main__":
    run_script(main)
