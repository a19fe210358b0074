"""Forms are compiled once: every problem of a process asks for the same ones."""

from __future__ import annotations

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip

from mpi4py import MPI

import numpy as np
import ufl
from blocks import LAYERS, block_mesh
from dolfinx import fem, jit, mesh
from sphere_on_block import sphere_on_block

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus.body import HalfSpace
from tactile_fem.study import Solver, Tissue

GRID = np.linspace(-1.0, 1.0, 2)


def test_a_second_and_third_problem_compile_nothing_new(monkeypatch):
    compile_, asked = jit.ffcx_jit, []

    def watched(*arguments, **options):
        found = compile_(*arguments, **options)
        asked.append(found[1].__name__)
        return found

    monkeypatch.setattr(jit, "ffcx_jit", watched)
    sets = []
    for _ in range(3):
        asked.clear()
        finger = block_mesh(GRID, GRID, np.linspace(0.0, 2.0, 5), LAYERS)
        domain = create_domain(finger, MPI.COMM_SELF, ["cut"])
        problem = FingerProblem(domain, Tissue(), HalfSpace(), 0.3, Solver())
        _ = problem.load_cell
        problem.close()
        sets.append(set(asked))
    assert len(sets[0]) > 5
    assert sets[0] == sets[1] == sets[2]


def test_constants_are_sorted_as_they_count():
    msh = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    x, signatures = ufl.SpatialCoordinate(msh), set()
    for _ in range(12):  # over any change from 9 to 10
        a, b = fem.Constant(msh, 1.0), fem.Constant(msh, 2.0)
        signatures.add(((a + x[0] * b) * ufl.dx).signature())
    assert len(signatures) == 1


def test_what_a_study_compiles_computes_what_the_tests_compile(monkeypatch):
    """Fast mathematics with all optimizations: the same to rounding."""
    found = []
    for _ in range(2):
        problem = sphere_on_block(Tissue(), MPI.COMM_SELF)
        for place in ((0, 0, 0.15), (0, 0, 0.3), (0, -0.1, 0.3)):
            assert problem.solve(np.array(place, dtype=float), 0.01).converged
            load = problem.accept()
        found.append(np.append(problem.u.x.array, load.force_N))
        monkeypatch.delenv("TACTILE_FEM_O3", raising=False)
    assert np.abs(found[0] - found[1]).max() < 1e-9
