"""Own terms of the virtual work: loads, energies, tags, and those that are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import ufl
from blocks import block_mesh
from materials import PROPOSED
from sphere_on_block import BALL, DEPTHS, TWO_TISSUES

from mpi4py import MPI  # isort: skip

from tactile_fem.errors import ConvergenceError, StudyError
from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.terms.term import Term
from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.plain import PlainSolver
from tactile_fem.study import Solver


def pressed(work, make_solver=FastSolver, depth_mm: float = 0.15) -> FingerProblem:
    """Return a block with that virtual work of `tissues` and `v`, a ball pressed into it."""

    class Own(Term):
        def residual(self, v):
            return work(self.tissues, v)

    line = np.linspace(-3, 3, 3)
    mesh = block_mesh(line, line, DEPTHS, TWO_TISSUES) if MPI.COMM_WORLD.rank == 0 else None
    domain = create_domain(mesh, MPI.COMM_WORLD, ("cut",))
    settings = Solver(held=("cut",), petsc={"snes_atol": 1e-11})
    made = FingerProblem(
        domain, PROPOSED, BALL, 0.3, settings, make_solver=make_solver, terms=[Own]
    )
    made.report = made.solve(np.array([0.0, 0.0, depth_mm]), 0.01)
    assert made.report.converged
    return made


def over_skin(tissues) -> ufl.Measure:
    ds = ufl.Measure("ds", subdomain_data=tissues.domain.surface)
    return ds(SURFACES["skin"], degree=2)


def weight(tissues, v):
    return 1e-4 * v[2] * tissues.dx


def of_many_kinds(tissues, v):
    """Dead loads, of which one is not assembled at points, an energy, and one that follows."""
    u, size = tissues.u, ufl.CellVolume(tissues.domain.mesh)
    force = ufl.as_vector([1e-3, 0.0, 0.0]) + 1e-4 * tissues.X
    return (
        weight(tissues, v)
        + 1e-4 * size * v[1] * tissues.dx
        + ufl.derivative(0.05 * ufl.div(u) ** 2 * tissues.dx, u, v)
        + 1e-4 * v[2] * over_skin(tissues)
        + ufl.inner(ufl.cross(v, u), force) * ufl.ds
    )


@pytest.mark.ranks
def test_both_solvers_find_the_same():
    """Also with tags of one's own and a tangent that is not symmetric."""
    fast, plain = (pressed(of_many_kinds, solver) for solver in (FastSolver, PlainSolver))
    np.testing.assert_allclose(fast.u.x.array, plain.u.x.array, rtol=0, atol=1e-8)
    force = fast.accept().force_N
    np.testing.assert_allclose(force, plain.accept().force_N, rtol=0, atol=1e-9)


@pytest.mark.ranks
def test_what_is_not_assembled_at_points_leaves_held_nodes_alone():
    """A stiff term without a degree of quadrature goes to DOLFINx: it takes no more iterations."""

    def stiff(dx):
        return lambda tissues, v: ufl.inner(ufl.grad(tissues.u), ufl.grad(v)) * dx(tissues)

    at_points, rest = pressed(stiff(lambda own: own.dx)), pressed(stiff(lambda own: ufl.dx))
    assert rest.report.iterations <= at_points.report.iterations + 1
    np.testing.assert_allclose(rest.u.x.array, at_points.u.x.array, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("work", "sentence"),
    [
        (lambda tissues, v: 1.0, "is of type float but must be a form"),
        (lambda tissues, v: v[2], "but must be a form: an integrand times dx or ds"),
        (lambda tissues, v: ufl.avg(v[2]) * ufl.dS, '"interior_facet"; allowed: dx and ds'),
        (lambda tissues, v: v[2] * ufl.dx(3), 'over the part "3" but its measure has no tags'),
        (lambda tissues, v: tissues.u[2] * tissues.dx, "must contain the test function v"),
        (lambda tissues, v: v[2] ** 2 * tissues.dx, "is not valid: "),
        (lambda tissues, v: (1 + v[2]) * tissues.dx, "is not valid: "),
        (
            lambda tissues, v: v[2] * ufl.FacetNormal(tissues.domain.mesh)[2] * tissues.dx,
            "is not valid: ",
        ),
    ],
)
def test_no_virtual_works(work, sentence):
    with pytest.raises(StudyError, match=f"parts.terms: the virtual work of Own .*{sentence}"):
        pressed(work)


@pytest.mark.ranks
def test_a_state_that_is_not_in_equilibrium_is_not_accepted():
    class Hasty(FastSolver):
        def solve(self):
            return replace(super().solve(), converged=True)

    made = pressed(weight, Hasty)
    made.u.x.array[:] *= 0.9
    with pytest.raises(ConvergenceError, match=r"not in equilibrium: contact force .* differ by"):
        made.accept()
