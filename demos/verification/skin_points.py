"""What acts at the contact quadrature points of the skin; shared by the demos of this folder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_fem import backend  # noqa: F401

import basix.ufl  # isort: skip  (after the backend, which finds it)
import ufl  # isort: skip
from dolfinx import fem, mesh  # isort: skip
from ufl.core.expr import Expr  # isort: skip

from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.mechanics.contact import smooth_positive
from tactile_fem.mechanics.problem import FingerProblem
from tactile_fem.study import Solver
from tactile_fem.tissue.energies import young_modulus


@dataclass(frozen=True)
class SkinPoints:
    """Contact quadrature points of the whole skin, on rank 0.

    Attributes
    ----------
    place_mm, deformed_mm
        Undeformed and deformed, (n, 3).
    area_mm2
        Undeformed area of each point, its quadrature weight, (n,).
    pressure_MPa, bulk_MPa
        Nitsche's contact pressure and that of the tissue's own Piola stress, (n,).
    gap_mm
        Distance from the body, negative inside it, (n,).
    facet
        Number of the point's facet, (n,).
    """

    place_mm: np.ndarray
    deformed_mm: np.ndarray
    area_mm2: np.ndarray
    pressure_MPa: np.ndarray
    bulk_MPa: np.ndarray
    gap_mm: np.ndarray
    facet: np.ndarray


class SkinProbe:
    """Evaluates a problem's skin, which has to be of one `tissue`."""

    def __init__(self, problem: FingerProblem, tissue: str, solver: Solver) -> None:
        msh, obstacle = problem.domain.mesh, problem.obstacle
        self._problem = problem
        facets = np.sort(problem.domain.surface.find(SURFACES["skin"]))
        submesh, entity_map = mesh.create_submesh(msh, 2, facets)[:2]
        element = basix.ufl.quadrature_element("triangle", degree=solver.contact_degree)
        # Tested with the quadrature element a form gives the values at the points times weights.
        q = ufl.TestFunction(fem.functionspace(submesh, element))
        N, X = ufl.FacetNormal(msh), ufl.SpatialCoordinate(msh)
        height = 3 * ufl.CellVolume(msh) / ufl.FacetArea(msh)
        E_MPa = young_modulus(problem.elasticity.constants(tissue))
        bulk = ufl.dot(problem.elasticity.stress(tissue) * N, obstacle.normal)
        pressure = smooth_positive(
            bulk - solver.nitsche_gamma * E_MPa / height * obstacle.gap, solver.contact_width_MPa
        )
        tags = mesh.meshtags(msh, 2, facets, np.ones_like(facets))
        ds = ufl.Measure(
            "ds",
            msh,
            subdomain_data=tags,
            metadata={"quadrature_degree": solver.contact_degree},
        )
        maps = [*obstacle.entity_maps, entity_map]

        def form(value: Expr | float) -> fem.Form:
            return fem.form(value * q * ds(1), entity_maps=maps)

        self._area = form(1.0)
        y = X + problem.u
        values = [X[0], X[1], X[2], y[0], y[1], y[2], pressure, bulk, obstacle.gap]
        self._values = [form(value) for value in values]

    def __call__(self) -> SkinPoints | None:
        """Return the points of all ranks on rank 0, None elsewhere."""
        self._problem.obstacle.refresh()
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
        place, deformed = np.transpose(rows[:3]), np.transpose(rows[3:6])
        return SkinPoints(place, deformed, area, *rows[6:], facet.astype(int))

    def _facet_of(self, area: np.ndarray) -> np.ndarray:
        """Return the facet's number of each point; the points of a facet follow each other."""
        V = self._area.function_spaces[0]
        facets = V.mesh.topology.index_map(2)
        count = facets.size_local + facets.num_ghosts
        return np.arange(len(area)) // (len(area) // max(count, 1))
