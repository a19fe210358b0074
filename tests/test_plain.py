"""The plain solver is the oracle: the fast one finds the same, on a block, a finger, a section."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest
from blocks import LAYERS
from materials import PROPOSED, RELAXING
from needs import needs_gmsh
from sphere_on_block import PRESS_AND_SLIDE, TWO_TISSUES, follow, sphere_on_block

from tactile_fem.simulation.simulation import Simulation
from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.plain import PlainSolver
from tactile_fem.study import Cylinder, Finger, Protocol, Receptors, Solver, Study, Text

TIGHT = Solver(petsc={"snes_atol": 1e-10}, max_press_step_mm=0.05)
SMALL = Finger(pad_size_mm=3.0, far_size_mm=6.0)
SECTION = Finger(kind="section", pad_size_mm=1.0, far_size_mm=3.0)


@pytest.mark.ranks
@pytest.mark.parametrize(
    ("tissue", "layers"),
    [(PROPOSED, LAYERS), pytest.param(RELAXING, TWO_TISSUES, marks=pytest.mark.slow)],
)
def test_on_a_block(tissue, layers):
    """Also what a linear equation with the Jacobian gives, whatever tangent was lagged."""
    found = []
    for make_solver in (FastSolver, PlainSolver):
        made = sphere_on_block(tissue, make_solver=make_solver, layers=layers)
        force = follow(made, *PRESS_AND_SLIDE).force_N
        with made.reopened(), made.solver.linearized() as solve:
            right = np.sin(np.arange(len(made.solver.residual()))).reshape(-1, 3)
            right[made.held[made.held < len(right)]] = 0.0
            moved = solve(1e-3 * right.ravel())
        found.append((made.u.x.array.copy(), force, made.solver.residual(), moved))
    (u, force, residual, moved), (plain_u, plain_force, plain_residual, plain_moved) = found
    np.testing.assert_allclose(u, plain_u, rtol=0, atol=1e-8)
    np.testing.assert_allclose(force, plain_force, rtol=0, atol=1e-8 * force[2] + 1e-9)
    np.testing.assert_allclose(residual, plain_residual, rtol=0, atol=1e-10)
    assert np.abs(moved).max(initial=0.0) > 1e-4
    np.testing.assert_allclose(moved, plain_moved, rtol=0, atol=1e-3 * np.abs(moved).max(initial=0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("finger", "stimulus", "depth_mm"),
    [
        pytest.param(SMALL, Text(text="G"), 0.4, id="small"),
        pytest.param(SECTION, Cylinder(radius_mm=4.0), 0.4, id="section", marks=needs_gmsh),
    ],
)
def test_on_a_finger(finger, stimulus, depth_mm):
    study = Study(
        finger=finger,
        stimulus=stimulus,
        protocol=Protocol(depth_mm=depth_mm, distance_mm=0.1),
        receptors=Receptors(half_width_mm=1.0, spacing_mm=1.0),
        solver=TIGHT,
    )
    found = []
    for make_solver in (FastSolver, PlainSolver):
        with closing(Simulation(study, make_solver=make_solver)) as simulation:
            steps = list(simulation.steps())
            felt = simulation.receptors.read()
            there = np.array([step.stimulator_mm for step in steps])
            found.append((there, np.array([step.load.force_N for step in steps]), felt.sed_kPa))
    (there, force, sed), (plain_there, plain_force, plain_sed) = found
    np.testing.assert_allclose(there, plain_there, rtol=0, atol=1e-12)  # no step was cut
    assert force[-1, 2] > 1e-3
    np.testing.assert_allclose(force, plain_force, rtol=0, atol=1e-6 * force.max())
    np.testing.assert_allclose(sed, plain_sed, rtol=0, atol=1e-6 * sed.max())
