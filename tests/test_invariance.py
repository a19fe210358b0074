"""Frame indifference, mirror symmetry and relative motion of bulk, contact, friction, viscosity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import ufl

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import LAYERS, block_mesh
from dolfinx import fem
from materials import PROPOSED
from scipy.spatial.transform import Rotation
from sphere_on_block import DEPTHS

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus.body import Distance, RigidBody
from tactile_fem.study import Solver, Text

LETTER = Text(text="F", g_width_mm=5.0, start_mm=0.0, corner_radius_mm=0.2, fillet_radius_mm=0.2)
PATH = [(0.0, 0.0, 0.05), (0.0, 0.0, 0.1), (0.01, -0.02, 0.1), (0.03, -0.08, 0.1)]
DT_S = 0.01
STILL = np.eye(3), np.zeros(3)
param, slow = pytest.param, pytest.mark.slow


@dataclass(frozen=True)
class Turned:
    """A body turned or mirrored by the orthogonal matrix `Q`."""

    body: RigidBody
    Q: np.ndarray

    def distance(self, points):
        d = self.body.distance(points @ self.Q)
        return Distance(d.gap, d.normal @ self.Q.T, self.Q @ d.hessian @ self.Q.T)


@dataclass(frozen=True)
class Outcome:
    """Force (3,), displacements (n, 3), and energy (m,) of each cell, in the file's order."""

    force: np.ndarray
    u: np.ndarray
    energy: np.ndarray


def made(Q, c) -> FingerProblem:
    """Return block and letter, both turned by `Q`; the block shifted by `c` as well."""
    line = np.linspace(-3, 3, 5)
    block = block_mesh(line, line, DEPTHS, LAYERS)
    block = replace(block, nodes=block.nodes @ Q.T + c)
    tight = Solver(held=("cut",), linear="direct", petsc={"snes_atol": 1e-9})
    domain = create_domain(block, MPI.COMM_WORLD, tight.held)
    problem = FingerProblem(domain, PROPOSED, Turned(LETTER.body(), Q), LETTER.friction, tight)
    problem.state.place(c)
    return problem


def outcome(problem: FingerProblem) -> Outcome:
    domain = problem.domain
    q = ufl.TestFunction(fem.functionspace(domain.mesh, ("DG", 0)))
    of_cells = fem.assemble_vector(fem.form(problem.bulk.stored(q))).array
    energy, owned = np.zeros(domain.cell_count), domain.owned_file_cells()
    energy[owned] = of_cells[: len(owned)]
    domain.comm.Allreduce(MPI.IN_PLACE, energy)
    u = domain.comm.bcast(problem.order.gather(problem.u))
    return Outcome(problem.load().force_N, u, energy)


def travel(problem: FingerProblem, places) -> Outcome:
    """Move the body along the places."""
    for number, place in enumerate(places):
        if number:
            problem.accept()
        report = problem.solve(np.asarray(place), DT_S)
        assert report.converged, report
    return outcome(problem)


@cache
def reference() -> Outcome:
    result = travel(made(*STILL), PATH)
    assert result.force[2] > 5e-3
    assert np.linalg.norm(result.force[:2]) > 0.1 * result.force[2]
    return result


def check(moved: Outcome, Q: np.ndarray, u_of=lambda u: u) -> None:
    still = reference()
    force, largest = np.linalg.norm(still.force), np.abs(still.u).max()
    np.testing.assert_allclose(moved.force, Q @ still.force, atol=1e-6 * force)
    np.testing.assert_allclose(moved.u, u_of(still.u @ Q.T), atol=1e-6 * largest)
    np.testing.assert_allclose(moved.energy, still.energy, atol=1e-6 * still.energy.max())


@pytest.mark.parametrize(
    "Q",
    [
        param(
            Rotation.from_euler("z", 90, degrees=True).as_matrix(), marks=slow, id="quarter turn"
        ),
        param(Rotation.from_euler("z", 180, degrees=True).as_matrix(), marks=slow, id="half turn"),
        param(Rotation.from_euler("x", 37, degrees=True).as_matrix(), marks=slow, id="about x"),
        param(
            Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix(),
            marks=pytest.mark.ranks,
            id="oblique",
        ),
        param(np.diag([-1.0, 1.0, 1.0]), id="mirrored in x"),
        param(np.diag([1.0, -1.0, 1.0]), marks=slow, id="mirrored in y"),
    ],
)
def test_turned_or_mirrored_everything_gives_the_same(Q):
    c = np.array([0.5, -2.0, 1.5])
    check(travel(made(Q, c), [Q @ place + c for place in PATH]), Q)


def test_moving_the_held_base_against_the_body_gives_the_same():
    """The body rests where it touches; the base moves by minus the body's displacement."""
    problem = made(*STILL)
    base = problem.bcs[0].g
    for number, place in enumerate(PATH):
        if number:
            problem.accept()
        # The guess meets the new condition: the residual lifts only homogeneous ones.
        problem.u.x.array.reshape(-1, 3)[:] -= np.asarray(place) + base.value
        base.value[:] = -np.asarray(place)
        assert problem.solve(np.zeros(3), DT_S).converged
    check(outcome(problem), np.eye(3), lambda u: u - np.asarray(PATH[-1]))
