"""The mechanics takes its dimension from the mesh: a section is in plane strain."""

from __future__ import annotations

import numpy as np
import pytest
import ufl

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip

from mpi4py import MPI

from dolfinx import fem, mesh

from tactile_fem.finger.mesh_data import SURFACES, TISSUES
from tactile_fem.mechanics.domain import Domain, roller
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus import Distance
from tactile_fem.study import Solver, Tissue
from tactile_fem.tissue.energies import ORIGIN

WIDTH, HEIGHT = 2.0, 1.0
ELASTIC = Tissue.model_validate({"set": "proposed", "viscous_time_s": 0.0})


class Floor:
    """The half-plane below."""

    def distance(self, points):
        count = len(points)
        return Distance(points[:, 1], np.tile([0.0, 1.0], (count, 1)), np.zeros((count, 2, 2)))


def section() -> Domain:
    """Return a rectangle of dermis, its lower side being skin, its upper one held."""
    msh = mesh.create_rectangle(MPI.COMM_SELF, [[0, 0], [WIDTH, HEIGHT]], [4, 3])
    cells = np.arange(msh.topology.index_map(2).size_local, dtype=np.int32)
    skin = np.sort(mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], 0)))
    nodes = fem.functionspace(msh, ("Lagrange", 2)).tabulate_dof_coordinates()[:, :2]
    return Domain(
        msh,
        mesh.meshtags(msh, 2, cells, np.full(len(cells), TISSUES["dermis"], dtype=np.int32)),
        mesh.meshtags(msh, 1, skin, np.full(len(skin), SURFACES["skin"], dtype=np.int32)),
        nodes,
        np.isclose(nodes[:, 1], HEIGHT),
        np.full(len(nodes), -1),
        cells,
        len(cells),
    )


def sides(V):
    return [roller(V, 0, lambda x: np.isclose(x[0], 0) | np.isclose(x[0], WIDTH))]


@pytest.fixture(scope="module", params=["direct", "multigrid"])
def problem(request):
    solver = Solver(held=("cut",), linear=request.param, petsc={"snes_atol": 1e-11})
    return FingerProblem(section(), ELASTIC, Floor(), 0.3, solver, sides)


def test_a_section_between_walls_is_pressed_as_the_law_says(problem):
    """Force per mm of thickness, moment, area and volume of an even compression, exactly."""
    assert problem.solve(np.array([0.0, 0.1]), 1.0).converged
    load = problem.accept()
    law, d = ELASTIC.dermis, 1e-5

    def energy(stretch):
        F = ufl.as_matrix([[1, 0, 0], [0, stretch, 0], [0, 0, 1]])
        return float(law.energy(F, ORIGIN)(()))

    # Pressing sets in over a pressure of 0.005 MPa: the skin comes a little nearer before.
    stretch = 1 + load.volume_change
    assert stretch == pytest.approx(0.9, abs=1e-4)
    expected = -WIDTH * (energy(stretch + d) - energy(stretch - d)) / (2 * d)
    np.testing.assert_allclose(load.force_N, [0.0, expected], rtol=1e-6, atol=1e-10)
    np.testing.assert_allclose(load.moment_Nmm, expected * WIDTH / 2, rtol=1e-6)
    assert load.contact_area_mm2 == pytest.approx(WIDTH)
    assert load.imbalance_N < 1e-9


def test_the_state_of_a_section_is_saved_and_restored(problem):
    problem.solve(np.array([0.02, 0.12]), 1.0)
    problem.accept()
    saved, u = problem.gather(), problem.u.x.array.copy()
    problem.solve(np.array([0.05, 0.2]), 1.0)
    problem.accept()
    assert np.abs(problem.u.x.array - u).max() > 0.01
    problem.restore(saved)
    np.testing.assert_array_equal(problem.u.x.array, u)
    np.testing.assert_allclose(problem.state.translation_old.value, [0.02, 0.12])
