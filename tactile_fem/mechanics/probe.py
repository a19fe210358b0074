"""What the receptors feel: strain energy density, von Mises stress, principal stretches."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import scipy.sparse
import ufl
from dolfinx import common
from dolfinx.mesh import entities_to_geometry

from tactile_fem.mechanics.compile import expression
from tactile_fem.mechanics.elasticity import deformation_gradient
from tactile_fem.mechanics.problem import FingerProblem
from tactile_fem.receptors import Samples
from tactile_fem.tissue.energies import law_of, stress

_KPA_PER_MPA = 1000.0


@dataclass(frozen=True)
class Feeling:
    """What the receptors feel at one moment.

    Attributes
    ----------
    sed_kPa, von_mises_kPa
        Strain energy density and Cauchy's von Mises stress, (receptors,).
    stretches
        Principal stretches in increasing order, (receptors, 3).
    """

    sed_kPa: np.ndarray
    von_mises_kPa: np.ndarray
    stretches: np.ndarray


class Probe:
    """Evaluates the fields at the receptors: located once, then one small product per step.

    Within a cell the fields are interpolated at cubic nodes, so a reading is a fixed linear
    combination of nodal values.
    """

    def __init__(self, problem: FingerProblem, samples: Samples, count: int, tissue: str) -> None:
        self._comm = problem.domain.comm
        self._mesh = problem.domain.mesh
        F = deformation_gradient(problem.u)
        W = problem.elasticity.energy(tissue)
        P = stress(law_of(problem.elasticity.constants(tissue)), F)
        sigma = P * F.T / ufl.det(F)
        deviator = ufl.dev(sigma)
        von_mises = ufl.sqrt(1.5 * ufl.inner(deviator, deviator) + 1e-30)
        C = F.T * F
        fields = ufl.as_vector(
            [
                _KPA_PER_MPA * W,
                _KPA_PER_MPA * von_mises,
                *(C[i, j] for i in range(3) for j in range(3)),
            ]
        )
        element = basix.ufl.element("DG", "tetrahedron", 3).basix_element
        self._expression = expression(fields, element.points)
        self._nodes = len(element.points)

        file_cells = problem.domain.owned_file_cells()
        owner = {int(cell): local for local, cell in enumerate(file_cells)}
        mine = np.array([int(c) in owner for c in samples.cell], dtype=bool)
        local = np.array([owner[int(c)] for c in samples.cell[mine]], dtype=np.int32)
        self._cells, column = np.unique(local, return_inverse=True)
        basis = self._basis(element, local, samples.point[mine])
        rows = np.repeat(samples.receptor[mine], self._nodes)
        columns = (column[:, None] * self._nodes + np.arange(self._nodes)).ravel()
        weights = (samples.weight[mine, None] * basis).ravel()
        shape = count, len(self._cells) * self._nodes
        self._weights = scipy.sparse.csr_array((weights, (rows, columns)), shape=shape)

    def _basis(self, element: object, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the nodal basis at physical points, (points, nodes)."""
        if not len(cells):
            return np.empty((0, self._nodes))
        corner = self._mesh.geometry.x[entities_to_geometry(self._mesh, 3, cells)]
        edges = np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2)
        reference = np.linalg.solve(edges, (points - corner[:, 0])[..., None])[..., 0]
        return element.tabulate(0, reference)[0, :, :, 0]

    def feel(self) -> Feeling:
        """Return what the receptors feel at the problem's present displacement."""
        with common.Timer("tactile: probe"):
            values = np.zeros((self._weights.shape[0], 11))
            if len(self._cells):
                nodal = self._expression.eval(self._mesh, self._cells).reshape(-1, 11)
                values += self._weights @ nodal
            self._comm.Allreduce(MPI.IN_PLACE, values)
        C = values[:, 2:].reshape(-1, 3, 3)
        stretches = np.sqrt(np.linalg.eigvalsh((C + np.swapaxes(C, 1, 2)) / 2))
        return Feeling(values[:, 0], values[:, 1], stretches)


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
        points, weights = basix.make_quadrature(basix.CellType.tetrahedron, 2)
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
