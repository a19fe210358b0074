"""A sphere pressed into a small layered block, on any number of ranks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import LAYERS, block_mesh
from materials import PROPOSED

from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.load import Load
from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus.body import RigidBody
from tactile_fem.study import Solver, Sphere, Tissue

TWO_TISSUES = ["stratum_corneum", *["subcutaneous"] * 3]  # half the code to compile
DEPTHS = np.array([0.0, 0.17, 0.82, 1.62, 3.0])
BALL = Sphere(radius_mm=3.0).body()
PRESS_AND_SLIDE = [(0, 0, 0.15), (0, 0, 0.3), (0, -0.05, 0.3), (0, -0.1, 0.3)]


def sphere_on_block(
    tissue: Tissue = PROPOSED,
    comm: MPI.Comm = MPI.COMM_WORLD,
    make_solver=FastSolver,
    body: RigidBody = BALL,
    count: int = 3,
    layers: Sequence[str] = LAYERS,
    petsc=None,
    **solver,
) -> FingerProblem:
    """Return a body, by default a ball, below a block of count x count bricks in each layer."""
    line = np.linspace(-3, 3, count + 1)
    mesh = block_mesh(line, line, DEPTHS, layers) if comm.rank == 0 else None
    domain = create_domain(mesh, comm, ("cut",))
    settings = Solver(held=("cut",), petsc={"snes_atol": 1e-11, **(petsc or {})}, **solver)
    return FingerProblem(domain, tissue, body, 0.3, settings, make_solver=make_solver)


def follow(problem: FingerProblem, *places, dt_s: float = 0.01) -> Load:
    """Move the body along the places, a step to each; return the load at the last one."""
    for place in places:
        report = problem.solve(np.array(place, dtype=float), dt_s)
        assert report.converged, report
        load = problem.accept()
    return load
