"""The Jacobian in two parts: products, entries and differences of the residual agree."""

from __future__ import annotations

import numpy as np
import pytest
from materials import PROPOSED, RELAXING
from sphere_on_block import PRESS_AND_SLIDE, TWO_TISSUES, follow, sphere_on_block

from dolfinx import fem  # isort: skip

from tactile_fem.path.rotations import matrix
from tactile_fem.solvers.finger_problem import FingerProblem


def random(made: FingerProblem, seed: int):
    """Return a random vector, the same on any number of ranks; zero where held."""
    values = np.random.default_rng(seed).normal(size=made.domain.nodes.shape)
    values[made.domain.held] = 0.0
    u, vector = fem.Function(made.u.function_space), made.solver.snes.getFunction()[0].duplicate()
    made.order.scatter(values, u)
    vector.array = u.x.array[: vector.getLocalSize()]
    return vector


def relative_error(found, wanted) -> float:
    size = wanted.norm()
    return (found - wanted).norm() / size


@pytest.mark.ranks
@pytest.mark.parametrize(
    ("tissue", "solver"),
    [(PROPOSED, {}), (PROPOSED, {"inertia": True}), (RELAXING, {"layers": TWO_TISSUES})],
    ids=["elastic", "inertia", "relaxing"],
)
def test_products_are_those_of_the_entries_and_differences_of_the_residual(tissue, solver):
    """The tangent has fewer points than the residual; products that read half of it are exact."""
    made = sphere_on_block(tissue, **solver)
    made.state.place(np.array([0.0, 0.0, 0.3]))
    made.begin_step(np.array([0.0, -0.05, 0.3]), 0.01, matrix([0.05, 0.0, 0.1]))
    x = random(made, 2)
    x.scale(1e-3)
    operator, entries, _ = made.solver.snes.getJacobian()
    made.solver.snes.computeJacobian(x, operator, entries)
    operator.getPythonContext().fill()
    direction = random(made, 0)
    found, wanted = direction.duplicate(), direction.duplicate()
    for way in ("mult", "multTranspose"):
        getattr(operator, way)(direction, found)
        getattr(entries, way)(direction, wanted)
        assert relative_error(found, wanted) < 1e-14
    operator.mult(direction, found)
    eps, sides = 1e-8, []
    for sign in (1, -1):
        there, residual = x.copy(), direction.duplicate()
        there.axpy(sign * eps, direction)
        made.solver.snes.computeFunction(there, residual)
        sides.append(residual)
    assert relative_error(found, (sides[0] - sides[1]) / (2 * eps)) < 0.03


@pytest.mark.ranks
def test_a_linearization_leaves_no_trace():
    """Sensitivities linearize with another tangent; the next step goes on with the lagged one."""
    found = []
    for linearizes in (False, True):
        made = sphere_on_block()
        follow(made, *PRESS_AND_SLIDE[:2])
        if linearizes:
            with made.reopened(), made.solver.linearized() as solve:
                solve(random(made, 0).array)
        follow(made, PRESS_AND_SLIDE[2])
        found.append((made.solver.snes.getLinearSolveIterations(), made.u.x.array.copy()))
    assert found[0][0] == found[1][0]
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=0, atol=1e-11)
