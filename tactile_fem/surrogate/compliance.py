"""The compliance of the pressed pad, from the finite elements: one solve for each cell of skin."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import KDTree

from tactile_fem import FingerMesh, Simulation
from tactile_fem.finger import SURFACES, lowest_height
from tactile_fem.stimulus import Plate
from tactile_fem.study import Study
from tactile_fem.surrogate.contact import NormalResponse, Pad, TangentialResponse
from tactile_fem.surrogate.heights import Grid

Array = NDArray[Any]
logger = logging.getLogger(__name__)

# The plate that the finger is pressed by, amid the depths of the scans.
_PRESSED_MM = 1.5
_HALF_MM = (8.0, 10.0)  # of the grid of heights
_CELLS_HALF_MM = (7.0, 8.0)
_SPACING_MM, _CELL_MM = 0.25, 0.5
_FAR_MM = 5.0  # Z of skin beside the finger
# Local compliance below the node spacing.
_LOCAL_mm_per_MPa = 1.0
_SOLVES = 96  # right-hand sides at a time


def pad_of(study: Study, deepest_mm: float) -> Pad:
    """Return the pad of a study's finger, which bodies press down to a depth; without drag yet.

    Only the calling process works. Raises TactileError as `Simulation` does.
    """
    pressed = study.model_copy(
        update={
            "stimulus": Plate(),
            "protocol": study.protocol.model_validate(
                {"depth_mm": _PRESSED_MM, "distance_mm": 0.0}
            ),
        }
    )
    with closing(Simulation(pressed, comm=MPI.COMM_SELF)) as simulation:
        grid = Grid.over(-np.array(_HALF_MM), _HALF_MM, _SPACING_MM)
        skin = _skin(simulation.finger, grid.points_mm)
        cells_grid = Grid.over(-np.array(_CELLS_HALF_MM), _CELLS_HALF_MM, _CELL_MM)
        near = _skin(simulation.finger, cells_grid.points_mm) <= deepest_mm
        for step in simulation.steps():
            logger.info("plate at %.2f mm: %.3f N", step.depth_mm, step.load.force_N[2])
        cells, compliance = _compliance(simulation, cells_grid, np.flatnonzero(near))
    response = NormalResponse(cells_grid, cells, compliance)
    return Pad(grid, skin.astype(np.float32), response, TangentialResponse(0.0, 1.0, 1.0))


def _skin(finger: FingerMesh, places: Array) -> Array:
    """Return Z of the undeformed skin's underside over places (n, 2); far where there is none."""
    facets = finger.nodes[finger.facets[finger.surface == SURFACES["skin"]][:, :3]]
    facets = facets[facets[:, :, 2].min(axis=1) < _FAR_MM]
    found = [lowest_height(x, y, facets) for x, y in places.tolist()]
    return np.array([_FAR_MM if z is None else min(z, _FAR_MM) for z in found])


def _compliance(
    simulation: Simulation, grid: Grid, wanted: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Array]:
    """Return the cells that lie on skin, and the motion in Z of each by a pressure on another."""
    problem = simulation.problem
    V, on_skin = problem.u.function_space, _nodes_of_skin(simulation)
    places = V.tabulate_dof_coordinates()[on_skin]
    # Weights (cells, nodes); NaN where a cell lies not between nodes.
    mean = LinearNDInterpolator(places[:, :2], np.eye(len(places)))(grid.points_mm[wanted])
    inside = np.isfinite(mean[:, 0])
    cells, mean = wanted[inside], mean[inside]
    dofs = 3 * on_skin + 2
    loads = grid.spacing_mm**2 * mean.T  # N at each node by 1 MPa on each cell
    moved = np.empty((len(cells), len(cells)))
    with _solver(simulation) as solve:
        for first in range(0, len(cells), _SOLVES):
            part = slice(first, min(first + _SOLVES, len(cells)))
            right = np.zeros((V.dofmap.index_map.size_local * 3, part.stop - part.start), order="F")
            right[dofs] = loads[:, part]
            moved[:, part] = mean @ solve(right)[dofs]
    moved = (moved + moved.T) / 2 + _LOCAL_mm_per_MPa * np.eye(len(cells))
    return cells, np.ascontiguousarray(moved, dtype=np.float32)


def _nodes_of_skin(simulation: Simulation) -> NDArray[np.int64]:
    """Return the numbers of the nodes on the underside of the skin, free to move."""
    problem = simulation.problem
    x = problem.u.function_space.tabulate_dof_coordinates()
    finger = simulation.finger
    facets = finger.facets[finger.surface == SURFACES["skin"]]
    nodes = finger.nodes[np.unique(facets)]
    nodes = nodes[nodes[:, 2] < _FAR_MM]
    distance, found = KDTree(x).query(nodes)
    assert distance.max() < 1e-6, "nodes of the mesh are those of the displacement"
    return np.setdiff1d(found, problem.held)


@contextmanager
def _solver(simulation: Simulation) -> Iterator[Any]:
    """Yield a function that solves with the static tangent of the tissue, of many loads at once."""
    problem = simulation.problem
    V = problem.u.function_space
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    problem.terms.freeze(None)
    form = problem.contact.obstacle.compile(
        ufl.derivative(problem.bulk.static_residual(v), problem.u, u)
    )
    K = fem_petsc.assemble_matrix(form, problem.bcs)
    K.assemble()
    factor = PETSc.KSP().create(K.comm)
    factor.setOperators(K)
    factor.setType("preonly")
    factor.getPC().setType("lu")
    factor.getPC().setFactorSolverType("mumps")

    def solve(right: Any) -> Array:
        B = PETSc.Mat().createDense(right.shape, array=right, comm=K.comm)
        B.assemble()
        X = B.duplicate()
        factor.matSolve(B, X)
        found = X.getDenseArray().copy()
        B.destroy()
        X.destroy()
        return found

    try:
        yield solve
    finally:
        factor.destroy()
        K.destroy()
