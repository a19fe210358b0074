"""A manufactured solution of the layered hyperelastic problem: the orders of P2."""

from __future__ import annotations

import numpy as np
import pytest
import ufl

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import LAYERS, block_mesh
from dolfinx import fem, mesh
from dolfinx.fem import petsc as fem_petsc
from terms import Bulk

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.solvers.options import LINEAR, NEWTON
from tactile_fem.study import Elastic, Polynomial, Solver, Tissue

LIMITS = np.array([0.0, 0.2, 0.45, 0.75, 1.1, 1.4])
# Two neo-Hookean layers, two of second order, St. Venant-Kirchhoff; the finger's constants.
ROWS = [*LAYERS, "nail"]
TISSUE = Tissue.model_validate({"viscous_time_s": 0.0})


def exact_displacement(x):
    """Return shears of up to one with little change of volume, kinked at every limit."""
    lift = 0.4 * (LIMITS[-1] - x[2])
    for side, limit in zip((-0.3, 0.3, -0.3, 0.3), LIMITS[1:-1], strict=True):
        lift += side * (LIMITS[-1] - ufl.max_value(x[2], limit))
    return lift * ufl.as_vector(
        [ufl.sin(3 * x[1] + x[2]), ufl.cos(2 * x[2]), 0.05 * ufl.sin(2 * x[0] + x[1])]
    )


def exact_stress(constants: Polynomial | Elastic, F):
    """Return the first Piola stress, differentiated by hand."""
    C, J, inverse = F.T * F, ufl.det(F), ufl.inv(F).T
    if isinstance(constants, Elastic):
        E_MPa, nu = constants.E_MPa, constants.nu
        E = (C - ufl.Identity(3)) / 2
        scale = E_MPa / (1 + nu)
        return F * scale * (nu / (1 - 2 * nu) * ufl.tr(E) * ufl.Identity(3) + E)
    shape = J ** (-2 / 3) * (F - ufl.tr(C) / 3 * inverse)
    a = J ** (-2 / 3) * ufl.tr(C) - 3
    slope = constants.C10_MPa + 2 * constants.C20_MPa * a + 3 * constants.C30_MPa * a**2
    return 2 * slope * shape + 2 / constants.D1_per_MPa * (J - 1) * J * inverse


def errors(rows: int, locking_ratio: float) -> tuple[float, float]:
    """Return the errors in L2 and in the H1 seminorm with that many rows in each layer."""
    line = np.linspace(0.0, 1.0, 2 * rows + 1)
    heights = np.interp(np.arange(5 * rows + 1) / rows, np.arange(6), LIMITS)
    block = block_mesh(line, line, heights, np.repeat(ROWS, rows).tolist())
    domain = create_domain(block, MPI.COMM_WORLD)
    bulk = Bulk(domain, TISSUE, Solver(locking_ratio=locking_ratio))
    V, u, v = bulk.V, bulk.u, ufl.TestFunction(bulk.V)
    exact = exact_displacement(ufl.SpatialCoordinate(domain.mesh))
    F = ufl.Identity(3) + ufl.grad(exact)
    dx = ufl.Measure(
        "dx", domain.mesh, subdomain_data=domain.tissue, metadata={"quadrature_degree": 6}
    )
    load = sum(
        ufl.inner(exact_stress(getattr(TISSUE, name), F), ufl.grad(v)) * dx(tag)
        for name, tag in domain.tissues_of(domain.tissue).items()
    )
    # Held all around: with dead tractions on free sides Newton's method does not reach the exact
    # state. Its nodal values are also the first guess.
    u.interpolate(fem.Expression(exact, V.element.interpolation_points))
    domain.mesh.topology.create_connectivity(2, 3)
    facets = mesh.exterior_facet_indices(domain.mesh.topology)
    boundary = fem.dirichletbc(u.copy(), fem.locate_dofs_topological(V, 2, facets))
    problem = fem_petsc.NonlinearProblem(
        bulk.residual(v) - load,
        u,
        bcs=[boundary],
        petsc_options_prefix="manufactured_",
        petsc_options={**NEWTON, **LINEAR["direct"], "snes_atol": 1e-11},
    )
    problem.solve()
    assert problem.solver.getConvergedReason() > 0
    e = u - exact
    squares = [ufl.inner(e, e) * dx, ufl.inner(ufl.grad(e), ufl.grad(e)) * dx]
    sums = (domain.comm.allreduce(fem.assemble_scalar(fem.form(square))) for square in squares)
    return tuple(np.sqrt(list(sums)))


@pytest.mark.ranks
@pytest.mark.parametrize("locking_ratio", [1e9, 25.0])
def test_p2_converges_with_order_three_in_L2_and_two_in_H1(locking_ratio):
    rows = [1, 2, 3]
    found = np.array([errors(n, locking_ratio) for n in rows])
    orders = -np.diff(np.log(found), axis=0) / np.diff(np.log(rows))[:, None]
    assert np.all(orders[:, 0] > 2.8), orders
    assert np.all(orders[:, 1] > 1.9), orders
