# %% [markdown]
# # Hertz: a rigid ball and a rigid bar on an elastic body
#
# This demo emphasizes
# - contact radius, peak pressure and force compared with the exact solutions, with convergence,
# - how the finite size of the body affects the depth, and how extrapolation removes this error,
# - how to read the contact pressure at the skin's quadrature points, where it is computed.
#
# A rigid ball of radius $R$ presses a half space of modulus $E^* = E/(1 - \nu^2)$ with the force
# $F$. Contact radius, peak pressure and depth are
#
# $$ a^3 = \frac{3 F R}{4 E^*}, \qquad p_0 = \frac{3 F}{2 \pi a^2}, \qquad \delta = a^2 / R, $$
#
# and the pressure is $p_0 \sqrt{1 - r^2/a^2}$. Under a bar with the load $f$ per length
#
# $$ a^2 = \frac{4 f R}{\pi E^*}, \qquad p_0 = \frac{2 f}{\pi a}, $$
#
# while its depth grows with the logarithm of the body's size and is therefore not compared.
# The contact radius comes from moments of the pressure, which need no threshold:
#
# $$ \int p\, r^2 \,dA = \tfrac{2}{5} F a^2 \text{ (ball)}, \qquad
#    \int p\, x^2 \,dA = \tfrac{1}{4} F a^2 \text{ (bar)}. $$
#
# Hertz's theory assumes small strains and shallow contact: $a/R$ is 0.05 here (`--slope`). The
# tissue is neo-Hookean with $\nu$ = 0.48, as in the finger. The body is a quarter of a half ball
# (half of a half disc, one element thick and in plane strain) with its outer surface fixed. This
# stiffens it: the force at a given depth is too high by a term in $a/L$, where $L$ is its radius.
# Two sizes determine this term. It hardly affects radius and pressure at a given force.
#
# `solver.contact_width_MPa` is an absolute pressure. The finger's 5 kPa would be an eighth of the
# peak pressure here, so it is set to less than a thousandth of it.
#
#     python demos/verification/hertz.py results/hertz
#     python demos/verification/hertz.py results/hertz --per-radius 4 --per-radius 8

# %%
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
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
E_MPa, NU = 1.0, 0.48
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
    """One solution, and Hertz at the same force; errors are relative.

    Attributes
    ----------
    per_radius
        Elements per mm, which is about one contact radius, in the contact.
    body_radius_mm
        Of the elastic body.
    force_N
        Of the ball; of the bar per mm of its length.
    contact_radius_mm, peak_MPa
        From the moments of the pressure, and from the best elliptic profile.
    profile_error
        Root mean square of the pressure minus Hertz's over the contact, by the peak pressure.
    depth_force_ratio
        Force to Hertz's at the same depth; NaN for the bar.
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


# %% [markdown]
# ## The body
# Gmsh meshes the sector of the half ball, or of the half disc one element thick. Elements are small
# in the contact zone and grow with the distance from it. Hertz's contact radius is about 1 mm.


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
    return FingerMesh(
        nodes, cells, np.full(len(cells), TISSUES["subcutaneous"]), triangles, surface
    )


# %%
def symmetry(shape: Shape, axes: tuple[int, ...] = (0, 1)) -> Constraints:
    """Keep the planes x = 0 and, under the ball, y = 0; the whole slice under the bar."""

    def conditions(V: fem.FunctionSpace) -> list[fem.DirichletBC]:
        everywhere = {1} if shape == "bar" else set()
        return [
            roller(V, axis, lambda x, i=axis: np.abs(x[i]) < (np.inf if i in everywhere else 1e-7))
            for axis in axes
        ]

    return conditions


# %% [markdown]
# ## One solution
# The depth is reached in a few equal steps; each starts from the last.


# %%
def depth_of(shape: Shape, ball_radius: float, body_radius: float) -> float:
    """Return the depth at which the contact radius is about 1 mm."""
    if shape == "ball":
        return 1 / ball_radius
    return (2 * math.log(2 * body_radius) - 1 - NU / (1 - NU)) / (4 * ball_radius)


@dataclass(frozen=True)
class Solution:
    """The pressed body; force and points of the part that is meshed."""

    shape: Shape
    R: float
    depth: float
    per_radius: float
    body_radius: float
    tetrahedra: int
    newton_iterations: int
    force_N: float
    points: SkinPoints | None


def press(shape: Shape, R: float, per_radius: float, body_radius: float) -> Solution:
    """Press a ball or bar of radius `R` on a body of the given mesh and size."""
    width = 1e-4 * E_STAR_MPa / R
    solver = Solver(held=("cut",), linear="direct", contact_width_MPa=width)
    finger = body_mesh(shape, per_radius, body_radius) if COMM.rank == 0 else None
    domain = create_domain(finger, COMM, solver.held)
    stimulus = Sphere(radius_mm=R) if shape == "ball" else Cylinder(radius_mm=R, along="y")
    problem = FingerProblem(domain, TISSUE, stimulus.body(), 0.0, solver, symmetry(shape))
    depth = depth_of(shape, R, body_radius)
    iterations = 0
    for share in np.linspace(0, 1, STEPS + 1)[1:]:
        report = problem.solve(np.array([0.0, 0.0, share * depth]), 1.0)
        if not report.converged:
            what = f"{shape}, {per_radius:g} elements per mm: {report.reason}"
            raise ConvergenceError(what, (0.0, 0.0, share * depth), report.reason)
        force = problem.accept().force_N[2]
        iterations += report.iterations
    points = SkinProbe(problem)()
    return Solution(
        shape, R, depth, per_radius, body_radius, domain.cell_count, iterations, force, points
    )


# %% [markdown]
# ## Against Hertz
# The peak is that of the elliptic profile fitted to the points within 0.8 a, so that it does not
# depend on a single outlier.


# %%
def compare(solution: Solution) -> Row:
    """Measure a solution and compare it with Hertz at the same force."""
    s, points = solution, solution.points
    p, area = points.pressure_MPa, points.area_mm2
    r = distance(s)
    total = np.sum(p * area)
    moment = np.sum(p * area * r**2) / total
    if s.shape == "ball":
        force = 4 * s.force_N
        a = (0.75 * force * s.R / E_STAR_MPa) ** (1 / 3)
        peak = 1.5 * force / (math.pi * a**2)
        found = math.sqrt(2.5 * moment)
        at_depth = 4 / 3 * E_STAR_MPa * math.sqrt(s.R) * s.depth**1.5
    else:
        force = 2 * s.force_N * s.per_radius
        a = math.sqrt(4 * force * s.R / (math.pi * E_STAR_MPa))
        peak = 2 * force / (math.pi * a)
        found = math.sqrt(4 * moment)
        at_depth = math.nan
    inside = r < 0.8 * found
    shape, weight = np.sqrt(1 - (r[inside] / found) ** 2), area[inside]
    fitted = np.sum(weight * p[inside] * shape) / np.sum(weight * shape**2)
    exact = peak * np.sqrt(np.maximum(1 - (r / a) ** 2, 0))
    rms = math.sqrt(np.sum(area * (p - exact) ** 2) / np.sum(area[r < a]))
    return Row(
        s.shape,
        s.per_radius,
        s.body_radius,
        s.tetrahedra,
        s.newton_iterations,
        force,
        found,
        found / a - 1,
        fitted,
        fitted / peak - 1,
        rms / peak,
        force / at_depth,
    )


def distance(solution: Solution) -> np.ndarray:
    """Return the deformed points' distance (n,) from the axis of the contact."""
    axes = [0, 1] if solution.shape == "ball" else [0]
    return np.linalg.norm(solution.points.deformed_mm[:, axes], axis=1)


# %% [markdown]
# The error caused by the body's size L decreases as 1/L, so the forces of two sizes at the same
# depth give the force of the half space.


# %%
def without_size(rows: list[Row]) -> list[tuple[float, float]]:
    """Return elements per mm and the extrapolated force ratio for each mesh of the ball."""
    found = []
    for n in sorted({row.per_radius for row in rows}):
        few = [row for row in rows if row.shape == "ball" and row.per_radius == n]
        if len(few) > 1:
            small, large = sorted(few, key=lambda row: row.body_radius_mm)[-2:]
            weights = np.array([-small.body_radius_mm, large.body_radius_mm])
            ratios = np.array([small.depth_force_ratio, large.depth_force_ratio])
            found.append((n, float(weights @ ratios / weights.sum())))
    return found


def print_results(rows: list[Row]) -> None:
    """Print the tables."""
    print("errors in % at the same force        radius    peak  profile rms  force/Hertz at depth")
    for row in rows:
        print(
            f"{row.shape} {row.per_radius:5g} per mm, body {row.body_radius_mm:4g} mm, "
            f"{row.tetrahedra:6d} tets  {100 * row.radius_error:6.2f}  "
            f"{100 * row.peak_error:6.2f}  {100 * row.profile_error:11.2f}  "
            f"{row.depth_force_ratio:.4f}"
        )
    for n, ratio in without_size(rows):
        print(f"ball {n:5g} per mm, body extrapolated to a half space: force/Hertz {ratio:.4f}")


# %%
COLOURS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00"]
NAMES = {"ball": "Ball", "bar": "Bar"}


def draw_profile(axes: Axes, solutions: list[Solution]) -> None:
    """Draw the scaled pressure at the points and Hertz's."""
    for colour, s in zip(COLOURS, solutions, strict=False):
        row = compare(s)
        peak = row.peak_MPa / (1 + row.peak_error)
        radius = row.contact_radius_mm / (1 + row.radius_error)
        r = distance(s) / radius
        near = r < 1.4
        axes.plot(
            r[near],
            s.points.pressure_MPa[near] / peak,
            ".",
            ms=2,
            color=colour,
            label=f"{s.per_radius:g} elements per $a$",
            rasterized=True,
        )
    x = np.linspace(0, 1, 400)
    axes.plot(np.append(x, 1.4), np.append(np.sqrt(1 - x**2), 0), "k", lw=1, label="Hertz")
    across = "r" if solutions[0].shape == "ball" else "x"
    axes.set(
        title=NAMES[solutions[0].shape],
        xlabel=f"${across}/a$",
        ylabel="Contact pressure $p/p_0$",
        xlim=(0, 1.4),
        ylim=(-0.05, 1.25),
    )
    axes.legend(frameon=False, markerscale=4, fontsize=8, loc="lower left")


def draw(solutions: list[Solution], rows: list[Row], picture: Path) -> None:
    """Draw pressure profiles and errors over the element size, for the largest body."""
    largest = max(row.body_radius_mm for row in rows)
    figure = Figure(figsize=(11.5, 3.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for axes, shape, marker in ((left, "ball", "o"), (middle, "bar", "s")):
        chosen = [s for s in solutions if s.shape == shape and s.body_radius == largest]
        if chosen:
            draw_profile(axes, chosen)
        few = [row for row in rows if row.shape == shape and row.body_radius_mm == largest]
        h = [1 / row.per_radius for row in few]
        for name, words, colour in (
            ("radius_error", "radius", COLOURS[0]),
            ("peak_error", "peak", COLOURS[4]),
            ("profile_error", "profile, rms", COLOURS[2]),
        ):
            errors = [100 * abs(getattr(row, name)) for row in few]
            line = "-" if shape == "ball" else "--"
            right.loglog(h, errors, line + marker, color=colour, ms=4, label=f"{shape}, {words}")
    right.set(xlabel="Element size $h/a$", ylabel="Error (%)", title="Errors at the same force")
    sizes = sorted({1 / row.per_radius for row in rows})
    right.set_xticks(sizes, [f"1/{1 / h:g}" for h in sizes])
    right.minorticks_off()
    figure.legend(*right.get_legend_handles_labels(), frameon=False, loc="outside right upper")
    figure.savefig(picture, dpi=150)


# %%
def main(
    folder: Path,
    *,
    per_radius: tuple[float, ...] = (4.0, 8.0, 16.0),
    body_radius: tuple[float, ...] = (20.0, 40.0),
    slope: float = 0.05,
) -> None:
    """Press balls and bars of radius 1/slope mm; write table and figure into the folder."""
    solutions = [
        press(shape, 1 / slope, n, L)
        for shape in ("ball", "bar")
        for n in per_radius
        for L in body_radius
    ]
    if COMM.rank:
        return
    rows = [compare(solution) for solution in solutions]
    print_results(rows)
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "hertz.csv", rows)
    draw(solutions, rows, folder / "hertz.png")


# %%
if __name__ == "__main__":
    run_script(main)
