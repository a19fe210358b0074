"""Strain energy density and stress in every cell, for the states that a scan keeps."""

from __future__ import annotations

import basix
import numpy as np
import ufl

from tactile_fem.assembly.compile import expression
from tactile_fem.mechanics.problem import Problem
from tactile_fem.mechanics.rows import gather_rows
from tactile_fem.results.fields import TENSOR
from tactile_fem.simulation.probe import material_point

_KPA_PER_MPA = 1000.0


class CellFields:
    """Means over each cell; cells of held tissues have none."""

    def __init__(self, problem: Problem) -> None:
        domain = problem.domain
        self._comm, self._mesh = domain.comm, domain.mesh
        self._count = domain.cell_count
        cell = getattr(basix.CellType, self._mesh.topology.cell_name())
        points, weights = map(np.asarray, basix.make_quadrature(cell, 2))
        self._weights = _KPA_PER_MPA * weights / weights.sum()
        # A section has its tensors in the axes of its plane, the axis across it last.
        axes = [*domain.plane.axes, *domain.plane.outside]
        entries = [(axes.index(i), axes.index(j)) for i, j in TENSOR]
        owned = domain.owned_file_cells()
        self._parts = []
        for name, tag in domain.tissues_of(domain.tissue).items():
            cells = domain.tissue.find(tag)
            cells = cells[cells < len(owned)]
            point = material_point(problem, name)
            values = [point.energy_MPa, *(point.cauchy_MPa[i, j] for i, j in entries)]
            self._parts.append((expression(ufl.as_vector(values), points), cells))
        cells = np.concatenate([owned[:0], *(owned[cells] for _, cells in self._parts)])
        # Of all ranks, on the first one.
        self._gathered = gather_rows(self._comm, cells[:, None])[:, 0]

    def gather(self, **own: np.ndarray) -> dict[str, np.ndarray]:
        """Return ``sed_kPa`` (cells,) and ``stress_kPa`` (cells, 6) on the first rank.

        The stress is Cauchy's; see `tactile_fem.results.fields.TENSOR` for its components. Values
        of this rank's `own` cells, (own cells,), are gathered as well. All ranks call; the others
        get none, (0,) and (0, 6).
        """
        columns = 1 + len(TENSOR) + len(own)
        means = [np.empty((0, columns))]
        for fields, cells in self._parts:
            if len(cells):
                local = fields.eval(self._mesh, cells).reshape(len(cells), len(self._weights), -1)
                mean = np.einsum("q,cqi->ci", self._weights, local)
                means.append(np.column_stack([mean, *(values[cells] for values in own.values())]))
        values = rows = gather_rows(self._comm, np.concatenate(means))
        if not self._comm.rank:
            values = np.zeros((self._count, columns))
            values[self._gathered] = rows
        stress, others = np.split(values[:, 1:], [len(TENSOR)], axis=1)
        return {
            "sed_kPa": values[:, 0],
            "stress_kPa": stress,
            **dict(zip(own, others.T, strict=True)),
        }
