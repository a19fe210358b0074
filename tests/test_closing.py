"""Problems on several ranks: they stay until closed, also where one rank collects alone."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import weakref

import pytest

from tactile_fem import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from test_multigrid import pressed


@pytest.mark.mpi
def test_a_problem_on_two_ranks_is_gone_when_closed_and_not_before():
    command = [ranks.launcher(), "-n", "2", sys.executable, __file__]
    told = subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
    assert json.loads(told.stdout) == {"open": [True, True], "closed": [False, False]}


def alive_after(comm: MPI.Comm, *, closed: bool) -> list[bool]:
    """Leave a problem; tell of each rank whether it lives on."""
    problem, _ = pressed(comm)
    trace = weakref.ref(problem)
    if closed:
        problem.close()
    del problem
    for rank in range(comm.size):
        if comm.rank == rank:
            gc.collect()  # waits for ever where it destroys what the ranks destroy together
        comm.barrier()
    return comm.allgather(trace() is not None)


if __name__ == "__main__":
    world = MPI.COMM_WORLD
    found = {"open": alive_after(world, closed=False), "closed": alive_after(world, closed=True)}
    if world.rank == 0:
        print(json.dumps(found))
