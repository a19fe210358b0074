"""Whatever UFL can say, the fast solver's residual and tangent are those of DOLFINx."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import ufl
from blocks import block_mesh
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from materials import PROPOSED
from sphere_on_block import BALL, TWO_TISSUES
from test_plane_strain import SAGITTAL, section
from test_virtual_work import moved, residual, tangent

from dolfinx import fem  # isort: skip
from mpi4py import MPI  # isort: skip

from tactile_fem.finger.mesh_data import SURFACES, TISSUES
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.measures import check_work
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus.body import Cut
from tactile_fem.study import Solver

# Of a vector field {f}, by rank; {i} is a number of a component. `curl` and `perp` by dimension.
OF_A_FIELD = {
    0: ["{f}[{i}]", "div({f})", "nabla_div({f})", "{f}[{i}].dx(0)", "tr(grad({f}))", "dot({f}, X)"],
    1: ["{f}", "{f}.dx({i})", "grad({f}) * X", "grad({f}[{i}])", "div(outer({f}, X))",
        "div(grad({f}))", "grad(div({f}))"],
    2: ["grad({f})", "nabla_grad({f})", "sym(grad({f}))", "skew(grad({f}))", "dev(grad({f}))",
        "outer({f}, X)", "grad({f}).T", "grad({f}) * grad(w)"],
}  # fmt: skip
BY_DIMENSION = {2: (0, ["curl({f})"]), 3: (1, ["curl({f})", "cross({f}, X)"])}
ON_FACETS = {0: ["dot({f}, n)"], 1: ["grad({f}) * n", "dot({f}, n) * n"], 2: ["outer({f}, n)"]}
FUNCTIONS = [
    "1", "c", "k", "X[0]", "cell", "exp({s})", "sin({s}) + c", "sqrt(1 + {s}**2)",
    "1 / (2 + {s}**2)", "conditional(gt({s}, 0), {s}, {s}**2)", "max_value({s}, 0.1)",
    "abs({s} - 0.1)", "atan({s})", "det(Identity(dim) + grad(u))",
    "inner(grad(c), X)", "CellVolume(domain)", "{s}",
]  # fmt: skip
IN_CELLS = ["dx", "dx(degree=2)", "dx(1)", "dx(skin, degree=3)", "plain_dx", "plain_dx(degree=1)"]
# Each example is compiled, so those that fail are not made smaller.
_SETTINGS = {"derandomize": True, "deadline": None, "database": None, "phases": [Phase.generate]}
AT_FACETS = ["ds", "ds(degree=2)", "tagged_ds(surface)", "tagged_ds(surface, degree=3)"]


@cache
def made(dim: int) -> tuple[FingerProblem, dict]:
    """Return a deformed block in contact, and the names that integrands use."""
    line = np.linspace(-3, 3, 2)
    if MPI.COMM_WORLD.rank:
        mesh = None
    elif dim == 3:
        mesh = block_mesh(line, line, np.array([0.0, 0.8, 3.0]), TWO_TISSUES[-2:])
    else:
        mesh = section(np.linspace(-3, 3, 4), np.linspace(0, 3, 3))
    domain = create_domain(mesh, MPI.COMM_WORLD, ("cut",))
    body = BALL if dim == 3 else Cut(BALL, SAGITTAL)
    problem = moved(FingerProblem(domain, PROPOSED, body, 0.3, Solver(held=("cut",))))
    tissues, msh = problem.tissues, domain.mesh
    c = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    c.interpolate(lambda x: 1 + 0.1 * np.sin(3 * x[0] + 2 * x[1]))
    cell = fem.Function(fem.functionspace(msh, ("DG", 0)))
    cell.interpolate(lambda x: 1 + 0.2 * x[0] ** 2)
    tags = {name: TISSUES[name] for name in tissues.tags}
    names = {
        **vars(ufl),
        **{"dim": dim, "domain": msh, "u": problem.u, "v": problem.test, "w": problem.state.u_old},
        **{"c": c, "cell": cell, "k": fem.Constant(msh, 0.7), "n": ufl.FacetNormal(msh)},
        **{"X": ufl.SpatialCoordinate(msh), "dx": tissues.dx, "plain_dx": ufl.Measure("dx", msh)},
        **{"skin": min(tags.values()), "surface": SURFACES["skin"], "ds": ufl.Measure("ds", msh)},
        "tagged_ds": ufl.Measure("ds", msh, subdomain_data=domain.surface),
    }
    return problem, names


@st.composite
def virtual_works(draw, dim: int) -> str:
    """Return a form in `v`: a function of fields, of any rank, times one of the test function."""
    is_on_facets = draw(st.booleans())
    rank = draw(st.sampled_from([0, 1, 2]))
    own_rank, own = BY_DIMENSION[dim]

    def of(field: str, rank: int) -> str:
        choices = OF_A_FIELD[rank] + own * (rank == own_rank) + ON_FACETS[rank] * is_on_facets
        return draw(st.sampled_from(choices)).format(f=field, i=draw(st.integers(0, dim - 1)))

    factor = draw(st.sampled_from(FUNCTIONS)).format(s=f"({of(draw(fields), 0)})")
    measure = draw(st.sampled_from(AT_FACETS if is_on_facets else IN_CELLS))
    if draw(st.integers(0, 3)) == 0:
        return f"derivative(({factor}) * ({of('u', 0)})**2 * {measure}, u, v)"
    return f"({factor}) * inner({of(draw(fields), rank)}, {of('v', rank)}) * {measure}"


fields = st.sampled_from(["u", "u", "u", "w"])


def check(dim: int, works: list[str]) -> None:
    problem, names = made(dim)
    form = sum((eval(work, names) for work in works), ufl.Form([]))
    if form.empty():
        return
    check_work(form, problem.test, "generated")
    work, compile_ = problem.virtual_work(form), problem.contact.obstacle.compile
    found, wanted = residual(work, problem), fem.assemble_vector(compile_(form)).array
    scale = max(1e-9, MPI.COMM_WORLD.allreduce(np.abs(wanted).max(initial=0), max))
    assert MPI.COMM_WORLD.allreduce(np.abs(found - wanted).max(initial=0), max) < 1e-11 * scale
    is_free = np.ones(len(problem.u.x.array) // dim, dtype=bool)
    is_free[problem.held] = False
    found = tangent(work, problem, is_free)
    slope = compile_(ufl.derivative(form, problem.u))
    trial = ufl.TrialFunction(problem.u.function_space)
    matrix = fem.create_matrix(fem.form(ufl.inner(trial, problem.test) * ufl.dx))
    wanted = fem.assemble_matrix(matrix, slope, problem.bcs, diag=0.0).to_dense()
    scale = max(1e-9, MPI.COMM_WORLD.allreduce(np.abs(wanted).max(initial=0), max))
    assert np.abs(found - wanted).max(initial=0) < 1e-11 * scale


@settings(max_examples=8, **_SETTINGS)
@given(st.lists(virtual_works(2), min_size=3, max_size=5))
def test_in_a_section(works):
    check(2, works)


@pytest.mark.slow
@settings(max_examples=30, **_SETTINGS)
@given(st.lists(virtual_works(2), min_size=1, max_size=3))
def test_many_in_a_section(works):
    check(2, works)


@pytest.mark.slow
@settings(max_examples=12, **_SETTINGS)
@given(st.lists(virtual_works(3), min_size=1, max_size=3))
def test_many_in_space(works):
    check(3, works)
