# %% [markdown]
# # Hertz: a rigid ball and a rigid bar on an elastic body
#
# With $E^* = E/(1 - \nu^2)$, a ball of radius $R$ under the force $F$, and a bar under $f$ per mm,
# have the contact radius $a$ and the peak pressure $p_0$
#
# $$ a^3 = \frac{3 F R}{4 E^*}, \quad p_0 = \frac{3 F}{2 \pi a^2} \qquad \text{and} \qquad
#    a^2 = \frac{4 f R}{\pi E^*}, \quad p_0 = \frac{2 f}{\pi a}; $$
#
# the ball's depth is $a^2/R$, the pressure is $p_0 \sqrt{1 - r^2/a^2}$. The radius found is that
# of moments of the pressure, without a threshold: $\int p\, r^2 dA$ is $\tfrac25 F a^2$ (ball) or
# $\tfrac14 F a^2$ (bar).
#
# $a/R$ is 0.05 and $\nu$ 0.48. The body is a quarter of a half ball, or half of a half disc in
# plane strain, with its outer surface fixed. That makes the ball's force at a depth too high by a
# term in $a/L$, with $L$ the body's radius, which two sizes determine. The contact width is a
# thousandth of the peak pressure.
#
#     python demos/verification/hertz.py results/hertz
#     python demos/verification/hertz.py results/hertz --per-radius 4 --per-radius 8

# %%
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from skin_points import SkinPoints, SkinProbe

from tactile_fem import ConvergenceError, FingerMesh, run_script, write_table
from tactile_fem.finger.mesh_data import SURFACES, TISSUES
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.simplex import facets_of, quadratic
from tactile_fem.mechanics.domain import create_domain, roller
from tactile_fem.mechanics.problem import Constraints
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Cylinder, Solver, Sphere, Tissue

from dolfinx import fem  # isort: skip  (after our own imports, which find it)
from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

COMM = MPI.COMM_WORLD
E_MPa, NU, R_MM = 1.0, 0.48, 20.0
E_STAR_MPa = E_MPa / (1 - NU**2)
TISSUE = Tissue.model_validate(
    {
        "viscous_time_s": 0.0,
        "subcutaneous": {
            "C10_MPa": E_MPa / (4 * (1 + NU)),
            "C20_MPa": 0.0,
            "D1_per_MPa": 6 * (1 - 2 * NU) / E_MPa,
        },
    }
)
Shape = Literal["ball", "bar"]
GROWTH = 0.3  # of the element size with the distance from the contact
STEPS = 4


@dataclass(frozen=True)
class Row:
    """One solution beside Hertz's at the same force; errors are relative.

    `per_radius` elements per mm, about one contact radius. `force_N` is per mm of the bar.
    `profile_error` is the pressure's, rms by the peak, `depth_force_ratio` the ball's force to
    Hertz's at the same depth.
    """

    shape: Shape
    per_radius: float
    body_radius_mm: float
    tetrahedra: int
    newton_iterations: int
    force_N: float
    contact_radius_mm: float
    radius_error: float
    peak_MPa: float
    peak_error: float
    profile_error: float
    depth_force_ratio: float


# %%
def body_mesh(shape: Shape, per_radius: float, radius: float) -> FingerMesh:
    """Return the graded body, its skin on z = 0 and its outer surface tagged as the cut."""
    h = 1 / per_radius

    def size(dim: int, tag: int, x: float, y: float, z: float, lc: float) -> float:
        del dim, tag, lc
        across = math.hypot(x, y) if shape == "ball" else x
        return h + GROWTH * math.hypot(max(0.0, across - 1.3), z)

    with gmsh_model() as gmsh:
        occ = gmsh.model.occ
        if shape == "ball":
            occ.addSphere(0, 0, 0, radius, angle1=0, angle2=math.pi / 2, angle3=math.pi / 2)
        else:
            points = [occ.addPoint(*at) for at in ((0, 0, 0), (radius, 0, 0), (0, 0, radius))]
            arc = occ.addCircleArc(points[1], points[0], points[2])
            sides = [occ.addLine(*points[:2]), arc, occ.addLine(points[2], points[0])]
            face = occ.addPlaneSurface([occ.addCurveLoop(sides)])
            occ.extrude([(2, face)], 0, h, 0, [1])
        occ.synchronize()
        gmsh.model.mesh.setSizeCallback(size)
        gmsh.model.mesh.generate(3)
        nodes, cells, _ = simplices(gmsh, 3)
    facets, _, second = facets_of(cells)
    facets = facets[second < 0]
    axes = [0, 1, 2] if shape == "ball" else [0, 2]
    outer = np.linalg.norm(nodes[:, axes], axis=1)
    skin = facets[np.all(np.abs(nodes[facets, 2]) < 1e-6, axis=1)]
    cut = facets[np.all(np.abs(outer[facets] - radius) < 1e-6, axis=1)]
    nodes, cells, triangles = quadratic(nodes, cells, np.concatenate([skin, cut]))
    surface = np.repeat([SURFACES["skin"], SURFACES["cut"]], [len(skin), len(cut)])
    tissue = np.full(len(cells), TISSUES["subcutaneous"])
    return FingerMesh(nodes, cells, tissue, triangles, surface)


def symmetry(shape: Shape, axes: tuple[int, ...] = (0, 1)) -> Constraints:
    """Keep the planes x = 0 and, under the ball, y = 0; the whole slice under the bar."""

    def conditions(V: fem.FunctionSpace) -> list[fem.DirichletBC]:
        everywhere = {1} if shape == "bar" else set()
        return [
            roller(V, axis, lambda x, i=axis: np.abs(x[i]) < (np.inf if i in everywhere else 1e-7))
            for axis in axes
        ]

    return conditions


# %%
def solve(shape: Shape, per_radius: float, body_radius: float) -> Row | None:
    """Press in equal steps; return the comparison on rank 0."""
    solver = Solver(held=("cut",), linear="direct", contact_width_MPa=1e-4 * E_STAR_MPa / R_MM)
    finger = body_mesh(shape, per_radius, body_radius) if COMM.rank == 0 else None
    domain = create_domain(finger, COMM, solver.held)
    ball = shape == "ball"
    stimulus = Sphere(radius_mm=R_MM) if ball else Cylinder(radius_mm=R_MM, along="y")
    problem = FingerProblem(domain, TISSUE, stimulus.body(), 0.0, solver, symmetry(shape))
    # The depth at which the contact radius is about 1 mm.
    depth = 1 / R_MM if ball else (2 * math.log(2 * body_radius) - 1 - NU / (1 - NU)) / (4 * R_MM)
    iterations = 0
    for share in np.linspace(0, 1, STEPS + 1)[1:]:
        report = problem.solve(np.array([0.0, 0.0, share * depth]), 1.0)
        if not report.converged:
            what = f"{shape}, {per_radius:g} elements per mm: {report.reason}"
            raise ConvergenceError(what, (0.0, 0.0, share * depth), report.reason)
        force = problem.accept().force_N[2]
        iterations += report.iterations
    points = SkinProbe(problem)()
    if points is None:
        return None
    whole = 4 * force if ball else 2 * force * per_radius
    at_depth = 4 / 3 * E_STAR_MPa * math.sqrt(R_MM) * depth**1.5 if ball else math.nan
    size = shape, per_radius, body_radius, domain.cell_count, iterations
    return Row(*size, whole, *compare(shape, whole, points), whole / at_depth)


def compare(shape: Shape, force_N: float, points: SkinPoints) -> tuple[float, ...]:
    """Return contact radius and error, peak and error, error of the profile.

    The peak is that of the elliptic profile fitted to the points within 0.8 a.
    """
    p, area = points.pressure_MPa, points.area_mm2
    r = np.linalg.norm(points.deformed_mm[:, [0, 1] if shape == "ball" else [0]], axis=1)
    moment = np.sum(p * area * r**2) / np.sum(p * area)
    if shape == "ball":
        a, found = hertz_radius(force_N), math.sqrt(2.5 * moment)
        peak = 1.5 * force_N / (math.pi * a**2)
    else:
        a, found = math.sqrt(4 * force_N * R_MM / (math.pi * E_STAR_MPa)), math.sqrt(4 * moment)
        peak = 2 * force_N / (math.pi * a)
    inside = r < 0.8 * found
    ellipse, weight = np.sqrt(1 - (r[inside] / found) ** 2), area[inside]
    fitted = np.sum(weight * p[inside] * ellipse) / np.sum(weight * ellipse**2)
    exact = peak * np.sqrt(np.maximum(1 - (r / a) ** 2, 0))
    rms = math.sqrt(np.sum(area * (p - exact) ** 2) / np.sum(area[r < a]))
    return found, found / a - 1, fitted, fitted / peak - 1, rms / peak


def hertz_radius(force_N: float) -> float:
    """Return the contact radius of the ball, mm."""
    return (0.75 * force_N * R_MM / E_STAR_MPa) ** (1 / 3)


# %%
def main(
    folder: Path,
    *,
    per_radius: tuple[float, ...] = (4.0, 8.0, 16.0),
    body_radius: tuple[float, ...] = (20.0, 40.0),
) -> None:
    """Press balls and bars on bodies of all meshes and sizes (mm); print and save the table."""
    found = [solve(s, n, L) for s in ("ball", "bar") for n in per_radius for L in body_radius]
    if COMM.rank:
        return
    rows = [row for row in found if row]
    print("errors in % at the same force        radius    peak  profile rms  force/Hertz at depth")
    for row in rows:
        print(
            f"{row.shape} {row.per_radius:5g} per mm, body {row.body_radius_mm:4g} mm, "
            f"{row.tetrahedra:6d} tets  {100 * row.radius_error:6.2f}  "
            f"{100 * row.peak_error:6.2f}  {100 * row.profile_error:11.2f}  "
            f"{row.depth_force_ratio:.4f}"
        )
    for n in per_radius if len(body_radius) > 1 else ():
        few = [row for row in rows if row.shape == "ball" and row.per_radius == n][-2:]
        small, large = sorted(few, key=lambda row: row.body_radius_mm)
        ratio = np.average(
            [small.depth_force_ratio, large.depth_force_ratio],
            weights=[-small.body_radius_mm, large.body_radius_mm],
        )
        print(f"ball {n:5g} per mm, body extrapolated to a half space: force/Hertz {ratio:.4f}")
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "hertz.csv", rows)


# %%
if __name__ == "__main__":
    run_script(main)
