"""What the receptors feel: strain energy density, stresses, stretches."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import scipy.sparse
import ufl
from dolfinx import common
from ufl.core.expr import Expr

from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.mechanics.compile import expression
from tactile_fem.mechanics.elasticity import deformation_gradient
from tactile_fem.mechanics.problem import FingerProblem
from tactile_fem.receptors import Samples

_KPA_PER_MPA = 1000.0
_COUNT = 17


@dataclass(frozen=True)
class ReceptorState:
    """What the receptors feel at one moment.

    Attributes
    ----------
    moved_mm
        Displacement, (receptors, 3).
    sed_kPa, von_mises_kPa
        Strain energy density and Cauchy's von Mises stress, (receptors,).
    stretches
        Principal stretches in increasing order, (receptors, 3).
    stresses_kPa
        Principal Cauchy stresses in increasing order, tension positive, (receptors, 3).
    """

    moved_mm: np.ndarray
    sed_kPa: np.ndarray
    von_mises_kPa: np.ndarray
    stretches: np.ndarray
    stresses_kPa: np.ndarray


class Probe:
    """Evaluates the fields at the receptors: located once, then one small product per step.

    Within a cell the fields are interpolated at cubic nodes, so a reading is a fixed linear
    combination of nodal values.

    Parameters
    ----------
    problem
        The finger, whose last step was accepted when it is read.
    samples, count
        Points to be averaged, and the number of receptors.

    Attributes
    ----------
    cells
        This rank's cells that are read.
    nodes
        Reference points at which fields are evaluated in each of them, (nodes, 3).
    weights
        Share of each cell's nodes in the readings, (receptors, cells x nodes).
    """

    def __init__(self, problem: FingerProblem, samples: Samples, count: int) -> None:
        self._comm = problem.domain.comm
        self._mesh = problem.domain.mesh
        self._plane = problem.domain.plane
        cell = self._mesh.topology.cell_name()
        element = basix.ufl.element("DG", cell, 3).basix_element
        self.nodes = element.points
        count_in_cell = len(self.nodes)

        file_cells = problem.domain.owned_file_cells()
        owner = {int(cell): local for local, cell in enumerate(file_cells)}
        mine = np.array([int(c) in owner for c in samples.cell], dtype=bool)
        local = np.array([owner[int(c)] for c in samples.cell[mine]], dtype=np.int32)
        self.cells, column = np.unique(local, return_inverse=True)
        basis = self._basis(element, local, self._plane.within(samples.point[mine]))
        rows = np.repeat(samples.receptor[mine], count_in_cell)
        columns = (column[:, None] * count_in_cell + np.arange(count_in_cell)).ravel()
        weights = (samples.weight[mine, None] * basis).ravel()
        shape = count, len(self.cells) * count_in_cell
        self.weights = scipy.sparse.csr_array((weights, (rows, columns)), shape=shape)

        self._fields = []
        for name, tag in TISSUES.items():
            if tag in samples.tissue:
                own = np.unique(column[samples.tissue[mine] == tag])
                self._fields.append((expression(_fields(problem, name), self.nodes), own))

    def _basis(self, element: object, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the nodal basis at physical points, (points, nodes)."""
        geometry = self._mesh.geometry
        dim = points.shape[1]
        reference = np.empty((len(cells), dim))
        for cell in np.unique(cells):
            inside = cells == cell
            corners = geometry.x[geometry.dofmaps[0][cell], :dim]
            reference[inside] = geometry.cmaps[0].pull_back(points[inside], corners)
        return element.tabulate(0, reference)[0, :, :, 0]

    def read(self) -> ReceptorState:
        """Return what the receptors feel at the problem's present displacement."""
        with common.Timer("tactile: probe"):
            count = _COUNT + len(self._plane.axes)
            nodal = np.zeros((len(self.cells), len(self.nodes), count))
            for fields, own in self._fields:
                if len(own):
                    nodal[own] = fields.eval(self._mesh, self.cells[own]).reshape(
                        len(own), -1, count
                    )
            values = self.weights @ nodal.reshape(-1, count)
            self._comm.Allreduce(MPI.IN_PLACE, values)
        C = values[:, 2:11].reshape(-1, 3, 3)
        stretches = np.sqrt(np.linalg.eigvalsh((C + np.swapaxes(C, 1, 2)) / 2))
        stresses = _principal(values[:, 11:17])
        moved = self._plane.vectors(values[:, _COUNT:])
        return ReceptorState(moved, values[:, 0], values[:, 1], stretches, stresses)


def _fields(problem: FingerProblem, tissue: str) -> Expr:
    """Return what is felt in a tissue, `_COUNT` numbers and the displacement's components.

    Energy, von Mises stress, C (9), Cauchy's stress (6).
    """
    F = deformation_gradient(problem.u)
    W = problem.elasticity.energy(tissue)
    # Read after a step was accepted: viscosity acts over that step.
    P = problem.elasticity.stress(tissue, problem.state.u_before)
    sigma = P * F.T / ufl.det(F)
    deviator = ufl.dev(sigma)
    von_mises = ufl.sqrt(1.5 * ufl.inner(deviator, deviator) + 1e-30)
    C = F.T * F
    return ufl.as_vector(
        [
            _KPA_PER_MPA * W,
            _KPA_PER_MPA * von_mises,
            *(C[i, j] for i in range(3) for j in range(3)),
            *(_KPA_PER_MPA * sigma[i, j] for i in range(3) for j in range(i + 1)),
            *(problem.u[i] for i in range(len(problem.u))),
        ]
    )


def _principal(lower: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of symmetric matrices of which the lower halves are given, (n, 6)."""
    matrices = np.zeros((len(lower), 3, 3))
    matrices[:, *np.tril_indices(3)] = lower
    sound = np.isfinite(lower).all(axis=1)
    values = np.full((len(lower), 3), np.nan)
    values[sound] = np.linalg.eigvalsh(matrices[sound])
    return values


class CellEnergy:
    """Strain energy density of every cell, for field files.

    Parameters
    ----------
    problem
        The finger; cells of held tissues have no energy.
    """

    def __init__(self, problem: FingerProblem) -> None:
        domain = problem.domain
        self._comm, self._mesh = domain.comm, domain.mesh
        self._count = domain.cell_count
        cell = getattr(basix.CellType, self._mesh.topology.cell_name())
        points, weights = basix.make_quadrature(cell, 2)
        self._weights = _KPA_PER_MPA * weights / weights.sum()
        owned = domain.owned_file_cells()
        self._parts = []
        for name, tag in domain.tissues_of(domain.tissue).items():
            cells = domain.tissue.find(tag)
            cells = cells[cells < len(owned)]
            energy = expression(problem.elasticity.energy(name), points)
            self._parts.append((energy, cells, owned[cells]))

    def gather(self) -> np.ndarray:
        """Return the mean strain energy density in kPa of the file's cells, on every rank."""
        values = np.zeros(self._count)
        for energy, cells, file_cells in self._parts:
            if len(cells):
                local = energy.eval(self._mesh, cells).reshape(len(cells), -1)
                values[file_cells] = local @ self._weights
        self._comm.Allreduce(MPI.IN_PLACE, values)
        return values
