# %% [markdown]
# # Effects of Nitsche's parameters on a block with sharp edges
#
# A block of dermis, 6 x 6 x 3 mm, is fixed on top, pressed on a flat plate by 10 % of its height
# and slid with friction 0.3 until it slips everywhere. At its edges the pressure is singular. The
# contact pressure and $\gamma$ are
#
# $$ s_n = [p - \gamma_h g]_+, \qquad \gamma_h = \gamma (K + 4G/3)/h, $$
#
# with $p$ the pressure of the tissue. Two numbers tell a wrong $\gamma$: penetration, and the
# oscillation of $s_n$ about its mean on a facet, rms relative to the mean, at points more than 1 mm
# from the edges.
#
#     python demos/verification/sharp_block.py results/sharp_block
#     python demos/verification/sharp_block.py results/quick --meshes 2 --gammas 1.2 --thetas 0

# %%
import math
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path

import numpy as np
from skin_points import SkinPoints, SkinProbe

from tactile_fem import FingerMesh, run_script, write_table
from tactile_fem.finger.mesh_data import SURFACES, TISSUES
from tactile_fem.finger.simplex import facets_of, quadratic
from tactile_fem.mechanics.domain import Domain, create_domain
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Plate, Solver, Tissue

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

COMM = MPI.COMM_WORLD
HALF_MM, HEIGHT_MM = 3.0, 3.0
TISSUE = Tissue.model_validate({"set": "maeno1998"})
PLATE = Plate(friction=0.3)
PRESS_MM = (0.1, 0.2, 0.3)
SLIDE_MM = (0.02, 0.1, 0.3, 0.6, 0.9, 1.2)
DT_S = 0.01


@dataclass(frozen=True)
class Row:
    """One choice of parameters; NaN and the failed step if Newton's method failed.

    `per_height` bricks of six tetrahedra over the block's height. `pressed_N`, `penetration_mm` and
    `oscillation` are those at the end of the press, the other forces of the end of the slide.
    """

    per_height: int
    theta: int
    gamma: float
    newton_iterations: int
    pressed_N: float
    normal_N: float
    tangential_N: float
    penetration_mm: float
    oscillation: float
    failed: str


# %%
def block(count: int) -> FingerMesh:
    """Return the block with `count` bricks over its height, skin below and cut on top."""
    sides = np.linspace(-HALF_MM, HALF_MM, 2 * count + 1)
    up = np.linspace(0.0, HEIGHT_MM, count + 1)
    nodes = np.stack(np.meshgrid(sides, sides, up, indexing="ij"), -1).reshape(-1, 3)
    index = np.arange(len(nodes)).reshape(len(sides), len(sides), len(up))
    tets = []
    for order in permutations(np.eye(3, dtype=int)):
        # Each tetrahedron follows three edges of the brick, from its first corner to the last.
        steps = np.cumsum([np.zeros(3, dtype=int), *order], axis=0)
        corners = [
            index[i : i + 2 * count, j : j + 2 * count, k : k + count].ravel() for i, j, k in steps
        ]
        odd = np.linalg.det(np.array(order)) < 0
        tets.append(np.stack(corners, -1)[:, [0, 2, 1, 3] if odd else [0, 1, 2, 3]])
    cells = np.concatenate(tets)
    facets = facets_of(cells)[0][facets_of(cells)[2] < 0]
    height = nodes[facets, 2]
    skin, cut = (facets[np.all(np.abs(height - z) < 1e-9, axis=1)] for z in (0.0, HEIGHT_MM))
    nodes, cells, triangles = quadratic(nodes, cells, np.concatenate([skin, cut]))
    surface = np.repeat([SURFACES["skin"], SURFACES["cut"]], [len(skin), len(cut)])
    return FingerMesh(nodes, cells, np.full(len(cells), TISSUES["dermis"]), triangles, surface)


# %%
def solve(domain: Domain, count: int, theta: int, gamma: float) -> Row:
    """Press and slide with one choice of the parameters."""
    solver = Solver(held=("cut",), linear="direct", nitsche_gamma=gamma, nitsche_theta=theta)
    problem = FingerProblem(domain, TISSUE, PLATE.body(), PLATE.friction, solver)
    iterations, pressed, seen = 0, math.nan, (math.nan, math.nan)
    press = [(0.0, depth) for depth in PRESS_MM]
    for slide, depth in [*press, *((slide, PRESS_MM[-1]) for slide in SLIDE_MM)]:
        report = problem.solve(np.array([0.0, -slide, depth]), DT_S)
        iterations += report.iterations
        if not report.converged:
            failed = f"slide {slide:g}" if slide else f"press {depth:g}"
            return Row(count, theta, gamma, iterations, pressed, math.nan, math.nan, *seen, failed)
        load = problem.load()
        if (slide, depth) == press[-1]:
            pressed = float(load.force_N[2])
            points = SkinProbe(problem)()
            if points is not None:
                seen = measures(points)
        _, along, normal = problem.accept(load).force_N.tolist()
    return Row(count, theta, gamma, iterations, pressed, normal, -along, *seen, "")


def measures(points: SkinPoints) -> tuple[float, float]:
    """Return penetration and oscillation."""
    area, pressure = points.area_mm2, points.pressure_MPa
    facet_area = np.bincount(points.facet, area)
    mean = (np.bincount(points.facet, area * pressure) / facet_area)[points.facet]
    inner = np.abs(points.place_mm[:, :2]).max(axis=1) < HALF_MM - 1.0
    weight = area[inner] / area[inner].sum()
    rms = math.sqrt(weight @ (pressure - mean)[inner] ** 2)
    return max(0.0, -points.gap_mm.min()), rms / (weight @ pressure[inner])


# %%
def main(
    folder: Path,
    *,
    meshes: tuple[int, ...] = (3, 5),
    gammas: tuple[float, ...] = (0.12, 0.6, 1.2, 2.4, 12.0, 40.0),
    thetas: tuple[int, ...] = (0, 1, -1),
) -> None:
    """Solve with all gammas, thetas and meshes; print and save the table."""
    rows = []
    for count in meshes:
        domain = create_domain(block(count) if COMM.rank == 0 else None, COMM, ("cut",))
        for theta, gamma in product(thetas, gammas):
            rows.append(solve(domain, count, theta, gamma))
            if COMM.rank == 0:
                print(rows[-1], flush=True)
    if COMM.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
        write_table(folder / "sharp_block.csv", rows)


# %%
if __name__ == "__main__":
    run_script(main)
