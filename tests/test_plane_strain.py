"""Plane strain: a section against a thin slab in space, and against Hertz's line contact."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip

from mpi4py import MPI

from sphere_on_block import follow

from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
from tactile_fem.finger.plane import Plane
from tactile_fem.finger.simplex import quadratic
from tactile_fem.mechanics.domain import create_domain, roller
from tactile_fem.receptors import Samples
from tactile_fem.simulation.probe import Probe
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus.body import Ball, Cut, HalfSpace
from tactile_fem.study import Solver, Tissue

SAGITTAL = Plane((1, 2))
SOLVER = Solver(held=("cut",), linear="direct", petsc={"snes_atol": 1e-12, "snes_max_it": 60})


def rectangle(y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes (n, 3) of X = 0 and triangles; numbers of the nodes as (y, z)."""
    grid = np.arange(len(y) * len(z)).reshape(len(y), len(z))
    nodes = np.stack(np.meshgrid(0.0, y, z, indexing="ij"), -1).reshape(-1, 3)
    a, b, c, d = (g.ravel() for g in (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]))
    return nodes, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]), grid


def tagged(nodes, cells, facets, surface) -> FingerMesh:
    nodes, cells, facets = quadratic(nodes, cells, facets)
    return FingerMesh(nodes, cells, np.full(len(cells), TISSUES["dermis"]), facets, surface)


def section(y: np.ndarray, z: np.ndarray) -> FingerMesh:
    nodes, cells, grid = rectangle(y, z)
    lines = [np.column_stack([row[:-1], row[1:]]) for row in (grid[:, 0], grid[:, -1])]
    tags = np.repeat([SURFACES["skin"], SURFACES["cut"]], len(y) - 1)
    return tagged(nodes, cells, np.concatenate(lines), tags)


def slab(y: np.ndarray, z: np.ndarray, width: float) -> FingerMesh:
    """Return the section with a width: each triangle a prism of three tetrahedra."""
    nodes, cells, _ = rectangle(y, z)
    count = len(nodes)
    nodes = np.vstack([nodes, nodes + np.array([width, 0.0, 0.0])])
    i, j, k = np.sort(cells, axis=1).T
    tets = np.concatenate(
        [
            np.column_stack(corners)
            for corners in (
                (i, j, k, k + count),
                (i, j, j + count, k + count),
                (i, i + count, j + count, k + count),
            )
        ]
    )
    wrong = np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]]) < 0
    tets[wrong] = tets[wrong][:, [1, 0, 2, 3]]
    facets, tags = [], []
    for corners in ([0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]):
        for tag, height in (("skin", z[0]), ("cut", z[-1])):
            own = tets[:, corners]
            own = own[np.all(nodes[own, 2] == height, axis=1)]
            facets.append(own)
            tags.append(np.full(len(own), SURFACES[tag]))
    return tagged(nodes, tets, np.concatenate(facets), np.concatenate(tags))


def pressed(mesh: FingerMesh, body, made: Tissue, place: np.ndarray, sides) -> FingerProblem:
    """Return a problem that sticks to a body, integrated to rounding."""
    domain = create_domain(mesh, MPI.COMM_SELF, ("cut",))
    exact = {"bulk_degree": 10, "locking_ratio": 1e9, "contact_degree": 16}
    problem = FingerProblem(domain, made, body, 50.0, SOLVER.model_copy(update=exact), sides)
    follow(problem, place / 2, place, dt_s=1e3)
    return problem


@pytest.mark.slow
def test_a_thin_slab_between_walls_is_the_section():
    """As the slab gets thin its displacement cannot change across it: equal to 1e-6.

    A plate that touches all of the skin and sticks: no edge of the contact, at which the
    quadratures of lines and triangles would differ.
    """
    y, z, width = np.linspace(-1, 1, 7), np.linspace(0, 1, 4), 3e-4
    made = Tissue.model_validate({"set": "proposed", "viscous_time_s": 0.0})
    place, plate = np.array([0.0, 0.03, 0.1]), HalfSpace()
    flat = pressed(section(y, z), Cut(plate, SAGITTAL), made, SAGITTAL.within(place), lambda V: [])
    solid = pressed(
        slab(y, z, width),
        plate,
        made,
        place,
        lambda V: [roller(V, 0, lambda x: np.isclose(x[0], 0) | np.isclose(x[0], width))],
    )
    force = flat.load().force_N
    np.testing.assert_allclose(solid.load().force_N[1:] / width, force, rtol=1e-6)
    assert force[1] > 1e-4
    moved = solid.order.gather(solid.u)
    at = {tuple(node): k for k, node in enumerate(np.round(solid.domain.nodes, 6).tolist())}
    same = [at[0.0, *node] for node in np.round(flat.domain.nodes, 6).tolist()]
    np.testing.assert_allclose(moved[same][:, 1:], flat.order.gather(flat.u), atol=1e-6)


def test_a_bar_presses_as_hertz_says():
    """The pressure below a cylinder's axis, of the half-plane: within 1 %."""
    radius, modulus = 1.0, 0.1
    fine = np.arange(0, 0.13, 0.008)
    line = np.concatenate([fine, fine[-1] + np.cumsum(np.geomspace(0.01, 1.5, 22))])
    mesh = section(np.concatenate([-line[:0:-1], line]), line)
    nu = 0.3
    shear, bulk = modulus / (2 * (1 + nu)), modulus / (3 * (1 - 2 * nu))
    # Compiled as in test_section.
    dermis = {"C10_MPa": shear / 2, "D1_per_MPa": 2 / bulk, "C20_MPa": 1e-12}
    made = Tissue.model_validate({"viscous_time_s": 0.0, "dermis": dermis})
    settings = SOLVER.model_copy(update={"contact_width_MPa": 1e-5})
    domain = create_domain(mesh, MPI.COMM_SELF, ("cut",))
    problem = FingerProblem(domain, made, Cut(Ball(radius, (1, 2)), SAGITTAL), 0.0, settings)
    force = follow(problem, (0, 0.005), (0, 0.01), (0, 0.015), dt_s=1e3).force_N[1]
    plane_modulus = modulus / (1 - nu**2)
    width = np.sqrt(4 * force * radius / (np.pi * plane_modulus))
    assert 0.03 < width < 0.1
    depth = 0.004
    corners = mesh.nodes[mesh.cells[:, :3], 1:]
    inside = corners.mean(axis=1)
    cell = np.argmin(np.linalg.norm(inside - [0.003, depth], axis=1))
    place = inside[cell]
    one = np.ones(1, dtype=int)
    samples = Samples(
        0 * one, cell * one, TISSUES["dermis"] * one, np.array([[0.0, *place]]), np.ones(1)
    )
    found = -Probe(problem, samples, 1).read().stresses_kPa[0, 0] / 1000
    at = width**2
    # On the axis p_0 / sqrt(1 + z^2/a^2), beside it to first order an ellipse.
    peak = 2 * force / (np.pi * width)
    exact = peak * np.sqrt(1 - place[0] ** 2 / at) / np.sqrt(1 + place[1] ** 2 / at)
    assert found == pytest.approx(exact, rel=0.01)
