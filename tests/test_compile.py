"""Forms are compiled once: every problem of a process asks for the same ones."""

from __future__ import annotations

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from blocks import block_mesh
from dolfinx import fem, jit, mesh
from materials import ONE_LAYER
from sphere_on_block import BALL, PRESS_AND_SLIDE, follow, sphere_on_block

from tactile_fem.assembly.compile import Constant, expression
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Solver


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
        problem = sphere_on_block(comm=MPI.COMM_SELF)
        _ = problem.load_cell
        expression(problem.bulk.stress("dermis"), np.full((1, 3), 0.25))
        problem.close()
        sets.append(set(asked))
    assert len(sets[0]) > 5
    assert sets[0] == sets[1] == sets[2]


def test_constants_are_sorted_as_they_count():
    msh = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    x, signatures = ufl.SpatialCoordinate(msh), set()
    for _ in range(12):  # over any change from 9 to 10
        a, b = Constant(msh, 1.0), Constant(msh, 2.0)
        signatures.add(((a + x[0] * b) * ufl.dx).signature())
    assert len(signatures) == 1


def test_constants_of_other_code_count_as_ufl_counts_them():
    msh = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    sphere_on_block(comm=MPI.COMM_SELF).close()
    first, own, second = fem.Constant(msh, 1.0), Constant(msh, 3.0), fem.Constant(msh, 2.0)
    assert first.count() < second.count() == first.count() + 1 < 10**6 < own.count()
    form = fem.form((second + own * first) * ufl.dx(msh))  # their values stay apart
    assert fem.assemble_scalar(form) == pytest.approx(5.0)


def test_what_a_study_compiles_computes_what_the_tests_compile(monkeypatch):
    """Fast mathematics with all optimizations: the same to rounding."""
    found, line = [], np.linspace(-3, 3, 4)
    solver = Solver(held=("cut",), petsc={"snes_atol": 1e-11})
    for _ in range(2):
        block = block_mesh(line, line, np.linspace(0, 3, 4), ["dermis"] * 3)
        domain = create_domain(block, MPI.COMM_SELF, ("cut",))
        problem = FingerProblem(domain, ONE_LAYER, BALL, 0.3, solver)
        load = follow(problem, *PRESS_AND_SLIDE)
        found.append(np.append(problem.u.x.array, load.force_N))
        monkeypatch.delenv("TACTILE_FEM_O3", raising=False)
    assert np.abs(found[0] - found[1]).max() < 1e-9
