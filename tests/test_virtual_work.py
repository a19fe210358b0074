"""The sums in several cells at once are those of DOLFINx's own assembly, for every term."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import ufl
from blocks import block_mesh, curved
from materials import PROPOSED, RELAXING
from sphere_on_block import BALL, DEPTHS, TWO_TISSUES, sphere_on_block

from dolfinx import fem, la, mesh  # isort: skip
from mpi4py import MPI  # isort: skip
from scipy.sparse import bsr_array  # isort: skip

from test_plane_strain import SAGITTAL, section

from tactile_fem.assembly import VirtualWork
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.terms.term import Term
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.near_skin import NearSkin
from tactile_fem.stimulus.body import Cut
from tactile_fem.study import Solver


def moved(made: FingerProblem, depth_mm: float = 0.3) -> FingerProblem:
    """Return the problem with a displacement and a body that slides into the skin."""
    dim = len(made.u)

    def wave(x):
        both = [9 * x[1] + x[0], 7 * x[0] + x[2], 5 * x[0] - 8 * x[1]]
        return 0.02 * np.sin(np.array(both[-dim:])) * (3 - x[dim - 1])

    made.u.interpolate(wave)
    made.state.u_old.interpolate(lambda x: 0.9 * wave(x))
    place = np.array([0.0, -0.05, depth_mm])[-dim:]
    made.begin_step(place, 0.01)
    made.contact.obstacle.refresh()
    return made


def curved_block() -> FingerProblem:
    line = np.linspace(-3, 3, 3)
    msh = curved(block_mesh(line, line, DEPTHS, TWO_TISSUES)) if MPI.COMM_WORLD.rank == 0 else None
    domain = create_domain(msh, MPI.COMM_WORLD, ("cut",))
    return FingerProblem(domain, PROPOSED, BALL, 0.3, Solver(held=("cut",)))


def plane() -> FingerProblem:
    msh = section(np.linspace(-3, 3, 9), np.linspace(0, 3, 4))
    domain = create_domain(msh if MPI.COMM_WORLD.rank == 0 else None, MPI.COMM_WORLD, ("cut",))
    return FingerProblem(domain, PROPOSED, Cut(BALL, SAGITTAL), 0.3, Solver(held=("cut",)))


class Odd(Term):
    """Work of a second derivative, and of the cells' sizes: nothing that is given at points."""

    def residual(self, v):
        u, dx = self.tissues.u, self.tissues.dx
        curvature = ufl.inner(ufl.grad(ufl.grad(u)), ufl.grad(ufl.grad(v)))
        return (curvature + ufl.CellVolume(self.tissues.domain.mesh) * ufl.inner(u, v)) * dx


@dataclass(frozen=True)
class Fibres:
    """A law that depends on the place."""

    def energy(self, F, at):
        X = at.X
        stretched = F * ufl.as_vector([1.0, X[0], X[1] * X[2]])
        return 0.01 * (ufl.dot(stretched, stretched) - 1) ** 2 + (ufl.det(F) - 1) ** 2


def with_odd_parts() -> FingerProblem:
    line = np.linspace(-3, 3, 3)
    msh = block_mesh(line, line, DEPTHS, TWO_TISSUES) if MPI.COMM_WORLD.rank == 0 else None
    domain = create_domain(msh, MPI.COMM_WORLD, ("cut",))
    solver = Solver(held=("cut",), linear="direct")
    laws = {"subcutaneous": Fibres()}
    return FingerProblem(domain, PROPOSED, BALL, 0.3, solver, laws=laws, terms=[Odd])


CASES = {
    "elastic": lambda: sphere_on_block(count=2, layers=TWO_TISSUES),
    "inertia": lambda: sphere_on_block(count=2, layers=TWO_TISSUES, inertia=True),
    "relaxing": lambda: sphere_on_block(RELAXING, count=2, layers=TWO_TISSUES),
    "curved": curved_block,
    "section": plane,
    "odd": with_odd_parts,
    "symmetric Nitsche": lambda: sphere_on_block(
        count=2, layers=TWO_TISSUES, nitsche_theta=1, compiler_flags=("-O1",)
    ),
}
RANKS = ("elastic", "relaxing", "section")


def residual(work: VirtualWork, made: FingerProblem) -> np.ndarray:
    """Return the residual of this rank's cells."""
    found = np.zeros_like(made.u.x.array)
    work.add_residual(found)
    return found


def slope(work: VirtualWork, made: FingerProblem, direction: np.ndarray) -> np.ndarray:
    """Return the residual's central difference along a direction."""
    u, eps, sides = made.u.x.array, 1e-7, []
    for sign in (1, -1):
        u += sign * eps * direction
        sides.append(residual(work, made))
        u -= sign * eps * direction
    return (sides[0] - sides[1]) / (2 * eps)


def tangent(work: VirtualWork, made: FingerProblem, is_free: np.ndarray) -> np.ndarray:
    """Return the tangent of this rank's cells."""
    u = ufl.TrialFunction(made.u.function_space)
    layout = fem.form(ufl.inner(u, made.test) * ufl.dx)
    matrix = fem.create_matrix(layout, block_mode=la.BlockMode.compact)
    matrix.set_value(0.0)
    work.add_tangent(matrix, is_free)
    columns = matrix.index_map(1).size_local + matrix.index_map(1).num_ghosts
    size, rows = len(made.u), len(matrix.indptr) - 1
    places = matrix.data.reshape(-1, size, size), matrix.indices, matrix.indptr
    found = bsr_array(places, shape=(size * rows, size * columns)).toarray()
    return found[:, : size * rows]


def difference(found: np.ndarray, wanted: np.ndarray) -> float:
    size = MPI.COMM_WORLD.allreduce(np.abs(wanted).max(initial=0), max)
    assert size > 0
    return MPI.COMM_WORLD.allreduce(np.abs(found - wanted).max(initial=0) / size, max)


@pytest.mark.parametrize(
    "case",
    [pytest.param(name, marks=[pytest.mark.ranks] if name in RANKS else []) for name in CASES],
)
def test_residuals_are_those_of_dolfinx_and_tangents_their_differences(case):
    made = moved(CASES[case]())
    works = []
    for term in (made.bulk, made.contact):
        form = term.residual(made.test)
        works.append(made.virtual_work(form, is_symmetric=term.is_symmetric))
        wanted = fem.assemble_vector(made.contact.obstacle.compile(form))
        assert difference(residual(works[-1], made), wanted.array) < 1e-12
        assert works[-1].is_at_points or case == "odd"
    form = made.bulk.work_of_tangent(made.test)
    works.append(made.virtual_work(form, is_symmetric=made.bulk.is_symmetric))
    for work in works:
        direction = np.sin(np.arange(len(made.u.x.array)))
        expected = slope(work, made, direction)
        matrix = tangent(work, made, np.ones(len(direction) // len(made.u), dtype=bool))
        assert difference(matrix @ direction, expected) < 1e-6


@pytest.mark.ranks
def test_facets_and_nodes_that_are_not_wanted_are_left_out():
    made = moved(sphere_on_block(layers=TWO_TISSUES))
    form = made.contact.residual(made.test)
    work, near = made.virtual_work(form), NearSkin(made.contact)
    whole = residual(work, made)
    assert near.update()
    work.choose(near.chosen)
    assert difference(residual(work, made), whole) < 1e-14
    is_free = np.arange(len(whole) // 3) % 2 == 0
    found, moves = tangent(work, made, is_free), np.repeat(is_free, 3)
    assert MPI.COMM_WORLD.allreduce(np.any(found[moves][:, moves]), MPI.LOR)
    assert not np.any(found[~moves])
    assert not np.any(found[:, ~moves])
    work.choose({})
    assert not residual(work, made).any()


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron", "triangle", "quadrilateral"])
def test_a_form_without_a_finger_is_assembled_as_by_dolfinx(cell):
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    create = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    msh = create(MPI.COMM_SELF, *[2] * dim, getattr(mesh.CellType, cell))
    V = fem.functionspace(msh, ("Lagrange", 2, (dim,)))
    u, v, X, n = (
        fem.Function(V),
        ufl.TestFunction(V),
        ufl.SpatialCoordinate(msh),
        ufl.FacetNormal(msh),
    )
    u.interpolate(lambda x: 0.1 * np.sin(x[:dim] + 2 * x[0]))
    msh.topology.create_connectivity(dim - 1, dim)
    ends = mesh.locate_entities_boundary(msh, dim - 1, lambda x: np.isclose(x[0], 1))
    tags = mesh.meshtags(msh, dim - 1, ends, np.full(len(ends), 7, dtype=np.int32))
    dx = ufl.Measure("dx", msh, metadata={"quadrature_degree": 4})
    ds = ufl.Measure("ds", msh, subdomain_data=tags, metadata={"quadrature_degree": 3})
    F = ufl.Identity(dim) + ufl.grad(u)
    form = ufl.derivative((ufl.inner(F, F) - ufl.ln(ufl.det(F))) * dx, u, v)
    form += (1 + X[0]) * ufl.dot(u, n) * ufl.dot(n, v) * ds(7)

    work = VirtualWork(form, u, v)
    wanted = fem.form(form), fem.form(ufl.derivative(form, u))
    b, A = np.zeros_like(u.x.array), fem.create_matrix(wanted[1], block_mode=la.BlockMode.compact)
    work.add_residual(b)
    work.add_tangent(A, np.ones(len(b) // dim, dtype=bool))
    assert difference(b, fem.assemble_vector(wanted[0]).array) < 1e-12
    assert difference(A.to_dense(), fem.assemble_matrix(wanted[1]).to_dense()) < 1e-12
    assert work.is_at_points
