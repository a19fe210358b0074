"""An error of one rank reaches all: nobody waits for ever. Also run under mpirun."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip
from petsc4py import PETSc  # isort: skip

from blocks import LAYERS, block_mesh

from tactile_fem.errors import MeshError, TactileError
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.runtime.ranks import on_root, shared_errors
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Plate, Solver, Tissue

pytestmark = pytest.mark.ranks
COMM = MPI.COMM_WORLD
DEPTHS = np.array([0.0, 0.17, 0.82, 1.62, 3.0])


def block():
    """Return a layered block, on rank 0."""
    line = np.linspace(-3, 3, 4)
    return block_mesh(line, line, DEPTHS, LAYERS) if COMM.rank == 0 else None


def problem(domain, body) -> FingerProblem:
    settings = Solver(held=("cut",), linear="direct")
    return FingerProblem(domain, Tissue.model_validate({}), body, 0.3, settings)


class OwnError(Exception):
    """One that cannot be sent to another rank."""

    def __init__(self, first, second):
        super().__init__(f"{first} and {second}")


@pytest.mark.parametrize("failing", range(COMM.size))
def test_all_ranks_raise_what_one_raises(failing):
    with pytest.raises(MeshError, match="of one rank"), shared_errors(COMM):
        if COMM.rank == failing:
            raise MeshError("of one rank")


def test_an_error_that_cannot_be_sent_is_told():
    def fail():
        raise OwnError("this", "that")

    known = OwnError if COMM.rank == 0 else TactileError
    with pytest.raises(known, match="this and that"):
        on_root(COMM, fail)


def test_without_an_error_nothing_is_raised():
    with shared_errors(COMM):
        pass


def test_a_node_that_only_one_rank_misses():
    domain = create_domain(block(), COMM, ("cut",))
    if COMM.rank == COMM.size - 1:
        nodes = domain.nodes.copy()
        nodes[:, 2] += 0.5
        domain = replace(domain, nodes=nodes)
    with pytest.raises(MeshError, match="a P2 node is not a node of the file"):
        problem(domain, Plate().body())


def test_a_mesh_that_only_rank_0_can_know_to_be_wrong():
    mesh = block()
    if mesh is not None:
        mesh = replace(mesh, facets=mesh.facets[:0], surface=mesh.surface[:0])
    with pytest.raises(IndexError):
        create_domain(mesh, COMM, ("cut",))


class HalfPlate:
    """A plate that ends beside the finger's middle, with an error beyond."""

    def distance(self, points):
        if (points[:, 0] > 2.0).any():
            raise ArithmeticError("this body has no distance here")
        return Plate().body().distance(points)


def test_a_body_that_fails_where_not_all_ranks_ask():
    pressed = problem(create_domain(block(), COMM, ("cut",)), HalfPlate())
    with pytest.raises(PETSc.Error) as caught:
        pressed.solve(np.array([0.0, 0.0, 0.1]), 0.01)
    assert "no distance here" in str(caught.value.__cause__)
