"""Tractions at the contact quadrature points of the skin; used by the scripts in this folder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem.runtime import backend  # noqa: F401

import ufl  # isort: skip  (after the backend, which finds it)
from dolfinx import fem  # isort: skip

from tactile_fem.solvers.finger_problem import FingerProblem


@dataclass(frozen=True)
class SkinPoints:
    """Contact quadrature points of the whole skin, on rank 0.

    `area_mm2` is the undeformed area of each point, its quadrature weight; `pressure_MPa` Nitsche's
    contact pressure, `bulk_MPa` that of the tissue's own Piola stress; `gap_mm` is negative inside
    the body; `facet` numbers the point's facet. Vectors are (n, 3), all others (n,).
    """

    place_mm: np.ndarray
    deformed_mm: np.ndarray
    area_mm2: np.ndarray
    friction_MPa: np.ndarray
    pressure_MPa: np.ndarray
    bulk_MPa: np.ndarray
    gap_mm: np.ndarray
    facet: np.ndarray


class SkinProbe:
    """Evaluates the skin of a problem, which must be of one tissue."""

    def __init__(self, problem: FingerProblem) -> None:
        self._problem = problem
        obstacle = problem.contact.obstacle
        # Tested with the quadrature element a form gives the values at the points times weights.
        q = ufl.TestFunction(obstacle.quadrature_function(()).function_space)
        (part,) = problem.contact.parts
        bulk = ufl.dot(part.law.t, obstacle.normal)
        X = ufl.SpatialCoordinate(problem.domain.mesh)
        values = [*X, *(X + problem.u), *part.law.s_t, part.law.s_n, bulk, obstacle.gap]
        self._area = obstacle.compile(q * part.ds)
        self._values = [obstacle.compile(value * q * part.ds) for value in values]

    def __call__(self) -> SkinPoints | None:
        """Return the points of all ranks on rank 0, None elsewhere."""
        self._problem.contact.obstacle.refresh()
        area = fem.assemble_vector(self._area).array
        mine = np.flatnonzero(area)  # a ghost facet's points are another rank's
        facets, of = np.unique(self._facet_of(area)[mine], return_inverse=True)
        rows = [fem.assemble_vector(form).array[mine] / area[mine] for form in self._values]
        comm = self._problem.domain.comm
        first = comm.exscan(len(facets)) or 0
        parts = comm.gather(np.stack([area[mine], first + of, *rows]))
        if comm.rank:
            return None
        area, facet, *rows = np.concatenate(parts, axis=1)
        place, deformed, friction = (np.transpose(rows[i : i + 3]) for i in (0, 3, 6))
        return SkinPoints(place, deformed, area, friction, *rows[9:], facet.astype(int))

    def _facet_of(self, area: np.ndarray) -> np.ndarray:
        """Return the facet number of each point; the points of a facet are consecutive."""
        facets = self._area.function_spaces[0].mesh.topology.index_map(2)
        count = facets.size_local + facets.num_ghosts
        return np.arange(len(area)) // (len(area) // max(count, 1))
