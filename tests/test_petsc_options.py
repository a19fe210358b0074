"""Each problem has options of its own in PETSc's one table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip
from petsc4py import PETSc  # isort: skip

from sphere_on_block import sphere_on_block

from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.options import check_options
from tactile_fem.study import Solver

OF_ALL = dict.fromkeys(("options_left", "vec_mdot_use_gemv", "vec_maxpy_use_gemv"), "")


def layered_block(**petsc) -> FingerProblem:
    """Return a layered block under a ball, not solved yet."""
    return sphere_on_block(comm=MPI.COMM_SELF, petsc=petsc)


def press(problem: FingerProblem) -> int:
    """Press the ball in a little and return the iterations of the linear solver."""
    report = problem.solve(np.array([0.0, 0.0, 0.2]), 0.01)
    assert report.converged
    return report.linear_iterations


def smoothing_steps(problem: FingerProblem) -> int:
    """Return how many steps the smoother of multigrid takes."""
    smoother = problem.solver.snes.getKSP().getPC().getMGSmoother(1)
    return int(smoother.getTolerances()[3])


@pytest.fixture
def database() -> Iterator[PETSc.Options]:
    """PETSc's table, whose new entries go afterwards."""
    options = PETSc.Options()
    before = set(options.getAll())
    yield options
    for name in set(options.getAll()) - before:
        del options[name]


def test_a_second_problem_leaves_the_first_ones_options_alone():
    alone = press(layered_block(mg_levels_ksp_max_it=2))
    first = layered_block(mg_levels_ksp_max_it=2)
    second = layered_block(mg_levels_ksp_max_it=5)
    check_options(Solver(linear="direct"))
    assert press(first) == alone
    press(second)
    assert (smoothing_steps(first), smoothing_steps(second)) == (2, 5)


def test_what_a_script_sets_after_import_is_heeded_and_wins(database):
    database["tactile_snes_max_it"] = 40
    database["tactile_mg_levels_ksp_max_it"] = 4
    problem = layered_block(snes_max_it=2, snes_atol=1e-9)
    press(problem)
    _, atol, _, most = problem.solver.snes.getTolerances()
    assert (atol, most, smoothing_steps(problem)) == (1e-9, 40, 4)
    assert problem.solver.options["snes_max_it"] == "40"


@pytest.mark.parametrize("end", ["closed", "forgotten"])
def test_a_problem_takes_its_options_along(database, end):
    before = database.getAll()
    problem = layered_block()
    assert len(database.getAll()) > len(before)
    if end == "closed":
        problem.close()
    del problem
    assert {**database.getAll(), **OF_ALL} == {**before, **OF_ALL}
