"""A sphere pressed into a small layered block, on any number of ranks."""

from __future__ import annotations

import numpy as np

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import LAYERS, block_mesh

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Solver, Sphere, Tissue

DEPTHS = np.array([0.0, 0.17, 0.82, 1.62, 3.0])


def sphere_on_block(
    tissue: Tissue, comm: MPI.Comm = MPI.COMM_WORLD, make_solver=FastSolver, **solver
) -> FingerProblem:
    line = np.linspace(-3, 3, 4)
    mesh = block_mesh(line, line, DEPTHS, LAYERS) if comm.rank == 0 else None
    domain = create_domain(mesh, comm, ("cut",))
    settings = Solver(held=("cut",), petsc={"snes_atol": 1e-11}, **solver)
    return FingerProblem(
        domain, tissue, Sphere(radius_mm=3.0).body(), 0.3, settings, make_solver=make_solver
    )
