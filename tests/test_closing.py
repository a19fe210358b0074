"""Problems on several ranks: they stay until closed, also where one rank collects alone."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref

import pytest

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from sphere_on_block import PRESS_AND_SLIDE, follow, sphere_on_block

from tactile_fem.errors import ConvergenceError
from tactile_fem.simulation.run import scan
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Finger, Solver, Study

several = pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="runs on several ranks")


@pytest.mark.ranks
@several
@pytest.mark.parametrize("closed", [False, True])
def test_a_problem_is_gone_when_closed_and_not_before(closed):
    assert alive_after(MPI.COMM_WORLD, closed=closed) == [not closed] * MPI.COMM_WORLD.size


@pytest.mark.ranks
@several
def test_a_scan_that_diverges_leaves_no_problem():
    assert not any(alive_after_divergence(MPI.COMM_WORLD))


@pytest.mark.mpi
def test_problems_left_open_on_two_ranks_let_the_program_end():
    command = [ranks.launcher(), "-n", "2", sys.executable, __file__]
    subprocess.run(command, check=True, capture_output=True, timeout=300)


def pressed(comm: MPI.Comm, **solver) -> FingerProblem:
    problem = sphere_on_block(comm=comm, **solver)
    follow(problem, *PRESS_AND_SLIDE)
    return problem


def alive_after(comm: MPI.Comm, *, closed: bool) -> list[bool]:
    """Leave a problem; tell of each rank whether it lives on."""
    problem = pressed(comm)
    trace = weakref.ref(problem)
    if closed:
        problem.close()
    del problem
    for rank in range(comm.size):
        if comm.rank == rank:
            gc.collect()  # waits for ever where it destroys what the ranks destroy together
        comm.barrier()
    return comm.allgather(trace() is not None)


def alive_after_divergence(comm: MPI.Comm) -> list[bool]:
    """Let a scan diverge; tell of each rank whether its problem lives on."""
    study = Study(
        finger=Finger(pad_size_mm=3.0, far_size_mm=6.0),
        solver=Solver(min_step_mm=0.02, petsc={"snes_max_it": 1}),
    )
    before = problems()
    with pytest.raises(ConvergenceError):
        scan(study, comm=comm)
    return comm.allgather(problems() > before)


def problems() -> int:
    gc.collect()  # the error held what its frames used
    return sum(isinstance(found, FingerProblem) for found in gc.get_objects())


if __name__ == "__main__":
    several = [pressed(MPI.COMM_WORLD, linear="direct") for _ in range(3)]
