# %% [markdown]
# # Cattaneo and Mindlin: a pressed ball that begins to slide
#
# This demo emphasizes
# - the stick and slip zones of the contact, compared with the exact solution,
# - the hysteresis of a cyclic tangential load,
# - the energy balance of every step: work of the ball, strain energy, heat of friction.
#
# A ball pressed with the force $P$ onto a half space has Hertz's pressure $p$ on a disc of radius
# $a$. With a tangential force $Q < \mu P$ a disc of radius $c$ sticks,
#
# $$ c/a = (1 - Q/\mu P)^{1/3}, \qquad
#    q(r) = \mu p_0 \left(\sqrt{1 - r^2/a^2} - \tfrac{c}{a} \sqrt{1 - r^2/c^2}\right), $$
#
# and moves the ball by
#
# $$ \delta = \delta_s \left(1 - (1 - Q/\mu P)^{2/3}\right), \qquad
#    \delta_s = \frac{3 (2 - \nu) \mu P}{16\, G a}. $$
#
# On unloading from $(\delta^*, Q^*)$ it follows
# $\delta^* - \delta = 2 \delta_s (1 - (1 - (Q^* - Q)/2\mu P)^{2/3})$. The stick radius is measured
# without a threshold: the second moment of the friction is
# $\int q\, r^2 dA = \mu (1 - c^5/a^5) \int p\, r^2 dA$.
#
#     python demos/verification/partial_slip.py results/partial_slip
#     python demos/verification/partial_slip.py results/quick --per-radius 4 --steps 4

# %%
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from hertz import COMM, NU, TISSUE, E_MPa, body_mesh, symmetry
from matplotlib.figure import Figure
from skin_points import SkinPoints, SkinProbe

from tactile_fem import ConvergenceError, FingerMesh, run_script, write_table
from tactile_fem.finger.simplex import quadratic
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.load import Load
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Solver, Sphere

R_MM, BODY_MM, FRICTION = 20.0, 20.0, 0.3
G_MPa = E_MPa / (2 * (1 + NU))
_PRESS_STEPS = 6


@dataclass(frozen=True)
class Row:
    """One step of the tangential load; forces are on the ball's whole contact.

    Attributes
    ----------
    slide_mm
        How far the ball has moved.
    share
        Q over mu P.
    stick_by_force, stick_by_moment
        Stick radius over contact radius on the first loading: from the force, from the friction's
        second moment; NaN on the way back.
    work_mJ, friction_mJ, stored_mJ
        Of the step: work of the ball, heat, gain of strain energy.
    balance
        Work less heat less gain, as a share of the largest work of a step.
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


# %% [markdown]
# The load breaks one of Hertz's symmetries, so half of the body is needed: the quarter and its
# mirror image.


# %%
def with_mirror_image(quarter: FingerMesh) -> FingerMesh:
    """Return the mesh and its mirror image at the plane y = 0."""
    corners, cells = np.unique(quarter.cells[:, :4], return_inverse=True)
    nodes = quarter.nodes[corners]
    cells = cells.reshape(-1, 4)
    triangles = np.searchsorted(corners, quarter.facets[:, :3])
    shared = np.abs(nodes[:, 1]) < 1e-7
    image = np.arange(len(nodes))
    image[~shared] = len(nodes) + np.arange(np.count_nonzero(~shared))
    both = np.concatenate([nodes, nodes[~shared] * [1, -1, 1]])
    all_nodes, tets, sides = quadratic(
        both,
        np.concatenate([cells, image[cells][:, [0, 2, 1, 3]]]),
        np.concatenate([triangles, image[triangles]]),
    )
    return FingerMesh(
        all_nodes, tets, np.tile(quarter.tissue, 2), sides, np.tile(quarter.surface, 2)
    )


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
    body = Sphere(radius_mm=R_MM).body()
    mirror_x = symmetry("ball", axes=(0,))
    problem = FingerProblem(domain, TISSUE, body, FRICTION, solver, mirror_x)
    probe = SkinProbe(problem)
    depth = 1 / R_MM
    states = []

    def go(leg: str, slide: float, height: float) -> None:
        report = problem.solve(np.array([0.0, slide, height]), 1.0)
        if not report.converged:
            what = f"{leg} at {slide:g} mm: {report.reason}"
            raise ConvergenceError(what, (0.0, slide, height), report.reason)
        states.append(State(leg, slide, problem.load(), probe()))
        problem.accept(states[-1].load)

    for share in np.linspace(0, 1, _PRESS_STEPS + 1)[1:]:
        go("press", 0.0, share * depth)
    ways = {"to": (0.0, 1.0, 1), "fro": (1.0, -1.0, 2), "to again": (-1.0, 1.0, 2)}
    for leg, (start, end, lengths) in ways.items():
        for share in np.linspace(start, end, lengths * steps + 1)[1:]:
            go(leg, share * furthest_mm, depth)
    return states


# %% [markdown]
# The strain energy of a step is the difference between its ends.


# %%
def rows_of(states: list[State]) -> list[Row]:
    """Return the table of the tangential load."""
    rows = []
    largest = max(abs(s.load.work_mJ) for s in states if s.leg != "press")
    for before, state in pairwise(states):
        if state.leg == "press":
            continue
        load, points = state.load, state.points
        normal, tangential = 2 * load.force_N[2], 2 * load.force_N[1]
        share = tangential / (FRICTION * normal)
        by_force = by_moment = math.nan
        if state.leg == "to":
            by_force = (1 - share) ** (1 / 3)
            r2 = radius(state) ** 2 * points.area_mm2
            ratio = (points.friction_MPa[:, 1] @ r2) / (FRICTION * points.pressure_MPa @ r2)
            by_moment = (1 - ratio) ** (1 / 5)
        stored = load.stored_mJ - before.load.stored_mJ
        parts = np.array([load.work_mJ, load.friction_mJ, stored])
        balance = (parts[0] - parts[1] - parts[2]) / largest
        rows.append(
            Row(state.leg, state.slide_mm, normal, share, by_force, by_moment, *parts, balance)
        )
    return rows


def radius(state: State) -> np.ndarray:
    """Return the distance of the skin's points from the axis of the ball, (n,)."""
    x, y, _ = state.points.deformed_mm.T
    return np.hypot(x, y - state.slide_mm)


# %% [markdown]
# ## Against the exact solution


# %%
def exact_share(slide_mm: np.ndarray, furthest_mm: float, slip_mm: float, leg: str) -> np.ndarray:
    """Return Q over mu P of Cattaneo and Mindlin on a leg of the loop."""

    def first(slide: np.ndarray) -> np.ndarray:
        return 1 - np.maximum(1 - slide / slip_mm, 0) ** 1.5

    turned = first(np.asarray(furthest_mm))
    match leg:
        case "to":
            return first(slide_mm)
        case "fro":
            return turned - 2 * first((furthest_mm - slide_mm) / 2)
        case _:
            return -turned + 2 * first((slide_mm + furthest_mm) / 2)


def slip_length(state: State) -> float:
    """Return delta_s with the pressed ball's force and Hertz's radius at that force."""
    normal = 2 * state.load.force_N[2]
    a = contact_radius(normal)
    return 3 * (2 - NU) * FRICTION * normal / (16 * G_MPa * a)


def contact_radius(normal_N: float) -> float:
    """Return Hertz's contact radius in mm."""
    return float((0.75 * normal_N * R_MM * (1 - NU**2) / E_MPa) ** (1 / 3))


def exact_friction(r: np.ndarray, state: State) -> np.ndarray:
    """Return Cattaneo's friction at the radius `r`, as a share of mu p0."""
    load = state.load
    a = contact_radius(2 * load.force_N[2])
    c = a * (1 - load.force_N[1] / (FRICTION * load.force_N[2])) ** (1 / 3)
    slip = np.sqrt(np.maximum(1 - (r / a) ** 2, 0))
    return slip - c / a * np.sqrt(np.maximum(1 - (r / c) ** 2, 0))


def profile_error(state: State) -> float:
    """Return the mean distance of the friction from Cattaneo's over the contact, over mu p0.

    The mean is over rings of a twentieth of the radius: single points show the noise of the
    traction between the facets.
    """
    found, expected, area = rings(state)
    return float(np.sqrt(area @ (found - expected) ** 2 / area.sum()))


def rings(state: State, count: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return friction found and expected, as shares of mu p0, and area of rings of the contact."""
    r = radius(state)
    normal = 2 * state.load.force_N[2]
    a = contact_radius(normal)
    scale = FRICTION * 1.5 * normal / (math.pi * a**2)
    ring = np.minimum((r / a * count).astype(int), count)
    area = state.points.area_mm2
    found = state.points.friction_MPa[:, 1] / scale
    expected = exact_friction(r, state)
    total = np.bincount(ring, area, count + 1)
    means = [np.bincount(ring, area * value, count + 1) / total for value in (found, expected)]
    return means[0][:count], means[1][:count], total[:count]


def print_results(rows: list[Row], states: list[State]) -> None:
    """Print the table and the errors."""
    print("     leg  slide mm  Q/(mu P)  c/a force  c/a moment    work mJ    heat mJ  balance")
    for r in rows:
        print(
            f"{r.leg:>8} {r.slide_mm:9.4f} {r.share:9.4f} {r.stick_by_force:10.3f} "
            f"{r.stick_by_moment:11.3f} {r.work_mJ:10.2e} {r.friction_mJ:10.2e} {r.balance:8.1e}"
        )
    loaded = [r for r in rows if r.leg == "to"]
    worst = max(abs(r.stick_by_moment / r.stick_by_force - 1) for r in loaded)
    print(f"stick radius: largest error {worst:.2%}")
    turned = next(s for s in reversed(states) if s.leg == "to")
    print(
        f"friction profile at Q/(mu P) = {loaded[-1].share:.2f}: error {profile_error(turned):.2%}"
    )
    print(f"energy balance: largest error of a step {max(abs(r.balance) for r in rows):.1e}")
    loop = [r for r in rows if r.leg != "to"]
    heat, work = sum(r.friction_mJ for r in loop), sum(r.work_mJ for r in loop)
    print(f"closed loop: heat {heat:.4e} mJ, work {work:.4e} mJ, {heat / work - 1:+.2%}")


# %%
def draw(rows: list[Row], states: list[State], furthest_mm: float, picture: Path) -> None:
    """Draw the friction's profile and the loop."""
    figure = Figure(figsize=(8.5, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    turned = next(s for s in reversed(states) if s.leg == "to")
    r = np.linspace(0, 1.2, 400)
    a = contact_radius(2 * turned.load.force_N[2])
    found, _, _ = rings(turned)
    left.plot((np.arange(len(found)) + 0.5) / len(found), found, "o", ms=4, label="tactile_fem")
    left.plot(r, exact_friction(a * r, turned), "k", lw=1, label="Cattaneo, Mindlin")
    slip = np.sqrt(np.maximum(1 - r**2, 0))
    left.plot(r, slip, "k:", lw=1, label=r"Coulomb's bound $\mu p$")
    left.set(xlabel="$r/a$", ylabel=r"Friction $q/\mu p_0$", xlim=(0, 1.2), ylim=(0, 1.05))
    left.legend(frameon=False)
    delta = slip_length(turned)
    for leg, start in (("to", 0.0), ("fro", 1.0), ("to again", -1.0)):
        few = [row for row in rows if row.leg == leg]
        path = np.linspace(start * furthest_mm, few[-1].slide_mm, 200)
        right.plot(
            1e3 * path,
            exact_share(path, furthest_mm, delta, leg),
            "k",
            lw=1,
            label="Cattaneo, Mindlin" if leg == "to" else None,
        )
        right.plot(
            [1e3 * row.slide_mm for row in few],
            [row.share for row in few],
            "o",
            ms=4,
            color="C0",
            label="tactile_fem" if leg == "to" else None,
        )
    right.set(xlabel="Slide (µm)", ylabel=r"Tangential force $Q/\mu P$")
    right.legend(frameon=False)
    figure.savefig(picture, dpi=150)


# %%
def main(
    folder: Path, *, per_radius: float = 8.0, furthest: float = 0.012, steps: int = 12
) -> None:
    """Press and stroke the ball; write table and figure into the folder.

    Parameters
    ----------
    per_radius
        Elements per contact radius.
    furthest
        Where the ball turns, in mm; all slips beyond 0.022.
    steps
        From the middle to there.
    """
    states = stroke(per_radius, furthest, steps)
    if COMM.rank:
        return
    rows = rows_of(states)
    print_results(rows, states)
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "partial_slip.csv", rows)
    draw(rows, states, furthest, folder / "partial_slip.png")


# %%
if __name__ == "__main__":
    run_script(main)
