"""Nitsche against a second formulation: penalty contact with return-mapping friction."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import ufl

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import block_mesh
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from materials import ONE_LAYER
from sphere_on_block import follow
from terms import Bulk

from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.mechanics.domain import NodeOrder, create_domain, roller
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.options import LINEAR, NEWTON
from tactile_fem.study import Solver, Sphere

BALL = Sphere(radius_mm=4.0, friction=0.3)
PATH = np.array(
    [(0, 0, 0.1), (0, 0, 0.2), (0, 0, 0.3), (0, 0, 0.4)] + [(0, -y, 0.4) for y in (0.02, 0.05, 0.1)]
)


@cache
def block():
    """Return half a block, fine under the ball; the plane x = 0 is one of symmetry."""
    x = np.array([0.0, 0.4, 0.8, 1.2, 1.6, 3.0])
    y = np.array([-3.0, -1.6, -1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2, 3.0])
    z = np.array([0.0, 0.4, 0.8, 1.6, 3.0])
    return create_domain(block_mesh(x, y, z, ["dermis"] * 4), MPI.COMM_SELF, ("cut",))


def symmetry(V):
    return [roller(V, 0, lambda x: np.abs(x[0]) < 1e-9)]


class Penalty:
    """The same body on the same block; `stiffness` in MPa/mm, the friction's history kept."""

    def __init__(self, stiffness: float) -> None:
        domain, degree = block(), 10
        msh = domain.mesh
        bulk = Bulk(domain, ONE_LAYER)
        V = bulk.V
        self.state = state = bulk.state
        self.u = state.u
        v = ufl.TestFunction(V)
        facets = np.sort(domain.surface.find(SURFACES["skin"]))
        self.obstacle = Obstacle(BALL.body(), state, facets, Solver(contact_degree=degree))
        self.shear_old = self.obstacle.quadrature_function((3,))
        nu, k = self.obstacle.normal, fem.Constant(msh, stiffness)
        pressure = k * ufl.max_value(-self.obstacle.gap, 0.0)
        motion = state.u - state.u_old - (state.translation - state.translation_old)
        trial = self.shear_old - k * motion
        trial -= ufl.dot(trial, nu) * nu
        size = ufl.sqrt(ufl.dot(trial, trial) + 1e-24)
        shear = trial * ufl.min_value(1.0, BALL.friction * pressure / size)
        skin = ufl.Measure(
            "ds", msh, subdomain_data=domain.surface, metadata={"quadrature_degree": degree}
        )(SURFACES["skin"])
        traction = pressure * nu + shear
        maps = self.obstacle.entity_maps
        held = NodeOrder(domain, V).held_dofs()
        self.held = [fem.dirichletbc(np.zeros(3), held, V), *symmetry(V)]
        self.problem = fem_petsc.NonlinearProblem(
            bulk.residual(v) - ufl.dot(traction, v) * skin,
            self.u,
            bcs=self.held,
            petsc_options_prefix="penalty_",
            petsc_options={**NEWTON, **LINEAR["direct"], "snes_max_it": 60},
            entity_maps=maps,
        )
        self.problem.solver.setFunction(self._residual, self.problem.b)
        self.force_forms = [fem.form(traction[i] * skin, entity_maps=maps) for i in range(3)]
        # Tested with the quadrature element a form gives the values at the points times weights.
        q = ufl.TestFunction(self.shear_old.function_space)
        ones = ufl.as_vector([1.0, 1.0, 1.0])
        self.weights = fem.assemble_vector(
            fem.form(ufl.dot(ones, q) * skin, entity_maps=maps)
        ).array
        self.shear_form = fem.form(ufl.dot(shear, q) * skin, entity_maps=maps)

    def _residual(self, snes, x, b):
        fem_petsc.assign(x, self.u)
        self.obstacle.refresh()
        p = self.problem
        fem_petsc.assemble_residual(snes, x, b, self.u, p.F, p.J, self.held)

    def move(self, place: np.ndarray) -> np.ndarray:
        """Return the force with the body at `place`, which becomes history."""
        self.state.translation.value[:] = place
        self.problem.solve()
        assert self.problem.solver.getConvergedReason() > 0, place
        self.obstacle.refresh()
        force = np.array([fem.assemble_scalar(form) for form in self.force_forms])
        shear = fem.assemble_vector(self.shear_form).array / self.weights
        self.shear_old.x.array[:] = shear
        self.state.place(place)
        return force


@cache
def nitsche() -> np.ndarray:
    solver = Solver(held=("cut",), linear="direct", contact_width_MPa=1e-5)
    problem = FingerProblem(block(), ONE_LAYER, BALL.body(), BALL.friction, solver, symmetry)
    return np.array([follow(problem, place, dt_s=1.0).force_N for place in PATH])


@cache
def penalty(stiffness: float) -> np.ndarray:
    problem = Penalty(stiffness)
    return np.array([problem.move(place) for place in PATH])


def test_nitsche_and_a_stiff_penalty_give_the_same_forces():
    """Normal force from 0.3 mm of depth on, friction from the start, where most still sticks."""
    one, other = nitsche(), penalty(8.0)
    np.testing.assert_allclose(other[2:, 2], one[2:, 2], rtol=0.01)
    np.testing.assert_allclose(other[4:, 1], one[4:, 1], rtol=0.01)


@pytest.mark.slow
def test_the_penalty_converges():
    soft, medium, stiff = (penalty(k)[-1, 1:] for k in (0.5, 2.0, 8.0))
    assert np.all(np.abs(stiff - medium) < np.abs(medium - soft) / 2)
