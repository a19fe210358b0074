"""What the receptors feel: strain energy density, stresses, stretches."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import scipy.sparse
import ufl
from dolfinx import common

from tactile_fem.assembly.compile import expression
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.mechanics.problem import Problem
from tactile_fem.neuron.fields import STANDARD, Field, MaterialPoint
from tactile_fem.receptors import Samples


@dataclass(frozen=True)
class ReceptorState:
    """What the receptors feel at one moment.

    Attributes
    ----------
    columns
        Value of each field by its name, (receptors,) or (receptors, n): ``sed_kPa``,
        ``von_mises_kPa``, ``stretches``, ``stresses_kPa``, ``moved_mm`` and those that the drives
        of the populations need. They are attributes as well.
    """

    columns: Mapping[str, np.ndarray]

    def __getattr__(self, name: str) -> np.ndarray:
        """Return a column."""
        columns = self.__dict__.get("columns", {})
        if name in columns:
            return columns[name]
        raise AttributeError(f"the receptors have no {name}, only {', '.join(columns)}")


class Probe:
    """Evaluates fields at the receptors: points located once, one small product for each step.

    Within a cell the fields are interpolated at cubic `nodes` (nodes, 3) of the reference cell, so
    a reading is a product with `weights` (receptors, cells x nodes) of the `cells` of this rank.

    Parameters
    ----------
    problem
        The finger, whose last step was accepted when it is read.
    samples, count
        Points to be averaged, and the number of receptors.
    fields
        What is evaluated.
    """

    def __init__(
        self, problem: Problem, samples: Samples, count: int, fields: Sequence[Field] = STANDARD
    ) -> None:
        self.fields = tuple(fields)
        self._comm = problem.domain.comm
        self._mesh = problem.domain.mesh
        element = basix.ufl.element("DG", self._mesh.topology.cell_name(), 3).basix_element
        self.nodes, nodes = element.points, len(element.points)

        file_cells = problem.domain.owned_file_cells()
        local = np.full(problem.domain.cell_count, -1, dtype=np.int32)
        local[file_cells] = np.arange(len(file_cells))
        mine = local[samples.cell] >= 0
        cells = local[samples.cell[mine]]
        self.cells, column = np.unique(cells, return_inverse=True)
        basis = self._basis(element, cells, problem.domain.plane.within(samples.point[mine]))
        rows = np.repeat(samples.receptor[mine], nodes)
        columns = (column[:, None] * nodes + np.arange(nodes)).ravel()
        weights = (samples.weight[mine, None] * basis).ravel()
        shape = count, len(self.cells) * nodes
        self.weights = scipy.sparse.csr_array((weights, (rows, columns)), shape=shape)

        self._compiled = []
        for name, tag in TISSUES.items():
            if tag in samples.tissue:
                point = material_point(problem, name)
                values = [ufl.as_ufl(field.at(point)) for field in self.fields]
                self._shapes = [value.ufl_shape for value in values]
                flat = [v[i] if i else v for v in values for i in np.ndindex(v.ufl_shape)]
                own = np.unique(column[samples.tissue[mine] == tag])
                self._compiled.append((expression(ufl.as_vector(flat), self.nodes), own))

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
        """Return what the receptors feel at the present displacement."""
        sizes = [math.prod(shape) for shape in self._shapes]
        with common.Timer("tactile: probe"):
            nodal = np.zeros((len(self.cells), len(self.nodes), sum(sizes)))
            for compiled, own in self._compiled:
                if len(own):
                    values = compiled.eval(self._mesh, self.cells[own])
                    nodal[own] = values.reshape(len(own), *nodal.shape[1:])
            means = self.weights @ nodal.reshape(-1, sum(sizes))
            self._comm.Allreduce(MPI.IN_PLACE, means)
        parts = np.split(means, np.cumsum(sizes)[:-1], axis=1)
        return ReceptorState(
            {
                field.name: field.of_mean(part.reshape(-1, *shape))
                for field, part, shape in zip(self.fields, parts, self._shapes, strict=True)
            }
        )


def material_point(problem: Problem, tissue: str) -> MaterialPoint:
    """Return the state of a tissue after an accepted step; viscosity acts over that step."""
    F, state = problem.tissues.F, problem.state
    P = ufl.replace(problem.bulk.stress(tissue), {state.u_old: state.u_before})
    displacement = [ufl.as_ufl(0)] * 3
    for component, axis in enumerate(problem.domain.plane.axes):
        displacement[axis] = problem.u[component]
    return MaterialPoint(
        ufl.as_vector(displacement), F, problem.bulk.energy(tissue), P * F.T / ufl.det(F)
    )
