"""A rigid body of any shape in UFL, by the second-order expansion of its signed distance.

The signed distance `g`, its gradient and its Hessian are evaluated at each contact quadrature
point at the current iterate `u0`. The form uses ``g + n.(u-u0) + (u-u0).H.(u-u0)/2``, so UFL's
derivative at ``u = u0`` is the exact tangent. The data are refreshed before each residual and
each Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr

from tactile_fem.mechanics.compile import expression
from tactile_fem.mechanics.state import State
from tactile_fem.runtime.parallel import shared_errors
from tactile_fem.stimulus.body import EXCESS_MM, RELIED_ON_MM, RigidBody

# Length of a gradient without direction.
_ZERO = 1e-12


class Obstacle:
    """The rigid body as the contact form sees it.

    Parameters
    ----------
    body
        Signed distance in the body's own frame.
    state
        Displacement of the finger and place of the body.
    facets
        This rank's facets that may touch.
    degree
        Quadrature degree on the facets.

    Attributes
    ----------
    translation, translation_old
        Where the body is, (3,) mm, now and at the last accepted step.
    gap, normal, hessian
        UFL expressions of the signed distance, of the outward normal and of the distance's second
        derivatives.
    entity_maps
        To be given to the compiler of any form that uses these expressions.
    entities
        Cell and local facet of each facet of this rank, ghosts included, (facets, 2).
    """

    def __init__(self, body: RigidBody, state: State, facets: np.ndarray, degree: int) -> None:
        self.body = body
        self.u = u = state.u
        parent = u.function_space.mesh
        self._at: tuple[np.ndarray, ...] = ()  # displacement and place of the last expansion
        self._spare_mm: np.ndarray | None = None  # of a facet's gap, beyond what matters
        self.translation, self.translation_old = state.translation, state.translation_old
        dim = parent.topology.dim
        submesh, entity_map = mesh.create_submesh(parent, dim - 1, facets)[:2]
        self.entity_maps: Sequence[mesh.EntityMap] = [entity_map]

        scheme = basix.quadrature.string_to_type("default")
        facet = getattr(basix.CellType, submesh.topology.cell_name())
        points, _ = basix.make_quadrature(facet, degree, rule=scheme)
        self._parent = parent
        self._position = expression(ufl.SpatialCoordinate(parent), points)
        self._displacement = expression(u, points)
        self.entities = _cells_and_local_facets(parent, entity_map, submesh)
        self._points_per_facet = len(points)

        self._submesh, self._degree = submesh, degree
        self._gap = self.quadrature_function(())
        self._normal = self.quadrature_function((dim,))
        self.hessian = self.quadrature_function((dim, dim))
        self._base = self.quadrature_function((dim,))
        du = u - self._base
        self.gap: Expr = self._gap + ufl.dot(self._normal, du) + ufl.dot(du, self.hessian * du) / 2
        gradient = self._normal + self.hessian * du
        # Unit already, but where two surfaces are blended; none where several are equally far.
        self.normal: Expr = gradient / ufl.sqrt(ufl.dot(gradient, gradient) + _ZERO**2)

    @property
    def comm(self) -> MPI.Comm:
        """The communicator of the finger."""
        return self._parent.comm

    def quadrature_function(self, shape: tuple[int, ...]) -> fem.Function:
        """Return a function with a value of `shape` at each contact quadrature point."""
        degree = self._degree
        cell = self._submesh.topology.cell_name()
        element = basix.ufl.quadrature_element(cell, value_shape=shape, degree=degree)
        return fem.Function(fem.functionspace(self._submesh, element))

    @cached_property
    def points_mm(self) -> np.ndarray:
        """Return the undeformed contact quadrature points of this rank, (n, dimension)."""
        return self._at_points(self._position).reshape(-1, self._parent.geometry.dim)

    def _at_points(self, value: fem.Expression) -> np.ndarray:
        """Return a vector at each point, (facets, points, dimension)."""
        shape = len(self.entities), self._points_per_facet, self._parent.geometry.dim
        if not shape[0]:
            return np.empty(shape)
        return value.eval(self._parent, self.entities).reshape(shape)

    @property
    def gap_mm(self) -> np.ndarray:
        """The signed distance as it was last expanded, (facets, points)."""
        return self._gap.x.array.reshape(len(self.entities), self._points_per_facet)

    def look_everywhere(self) -> None:
        """Expand the distance of all facets at the next `refresh`."""
        self._spare_mm, self._at = None, ()

    def overlook(self, reach_mm: np.ndarray) -> None:
        """Leave facets as they are until they may have come within reach, or the body has moved.

        A facet that moves by less than it has to spare stays out of reach: see `RigidBody`.

        Parameters
        ----------
        reach_mm
            Gap below which it matters, (facets,).
        """
        relied_on = np.minimum(self.gap_mm.min(axis=1), RELIED_ON_MM)
        self._spare_mm = relied_on - EXCESS_MM - reach_mm
        self._seen_from = self._base.x.array.copy()

    def refresh(self) -> None:
        """Expand the signed distance anew at the current displacement; all ranks must call."""
        with shared_errors(self.comm):  # a user's own body may fail on one of them
            self._refresh()

    def _refresh(self) -> None:
        if not len(self.entities):
            return
        now = self.u.x.array, self.translation.value
        if self._at and all(map(np.array_equal, now, self._at)):
            return  # the Jacobian follows a residual at the same place
        if self._at and not np.array_equal(now[1], self._at[1]):
            self._spare_mm = None
        u = self._at_points(self._displacement)
        near = self._may_be_near(u)
        y = self.points_mm.reshape(u.shape)[near] + u[near] - self.translation.value
        if len(y):
            d = self.body.distance(y.reshape(-1, y.shape[-1]))
            _set(self._gap, near, d.gap)
            _set(self._normal, near, d.normal)
            _set(self.hessian, near, d.hessian)
            _set(self._base, near, u[near])
        self._at = tuple(values.copy() for values in now)

    def _may_be_near(self, u: np.ndarray) -> np.ndarray:
        """Return which facets the body may be near, all if that is not known; (facets,)."""
        if self._spare_mm is None:
            return np.ones(len(u), dtype=bool)
        moved = u - self._seen_from.reshape(u.shape)
        moved_mm = np.sqrt(np.einsum("fpi,fpi->fp", moved, moved).max(axis=1))
        return self._spare_mm < moved_mm


def _set(function: fem.Function, facets: np.ndarray, values: np.ndarray) -> None:
    """Set a quadrature function on some facets."""
    function.x.array.reshape(len(facets), -1)[facets] = values.reshape(facets.sum(), -1)


def _cells_and_local_facets(
    parent: mesh.Mesh, entity_map: mesh.EntityMap, submesh: mesh.Mesh
) -> np.ndarray:
    """Return (cell, local facet) of each facet of the submesh, (facets, 2)."""
    dim = parent.topology.dim
    index_map = submesh.topology.index_map(dim - 1)
    count = index_map.size_local + index_map.num_ghosts
    facets = entity_map.sub_topology_to_topology(np.arange(count, dtype=np.int32), False)
    parent.topology.create_connectivity(dim - 1, dim)
    parent.topology.create_connectivity(dim, dim - 1)
    to_cell = parent.topology.connectivity(dim - 1, dim)
    to_facet = parent.topology.connectivity(dim, dim - 1)
    pairs = np.empty((count, 2), dtype=np.int32)
    for row, facet in enumerate(facets):
        cell = to_cell.links(facet)[0]
        pairs[row] = cell, np.flatnonzero(to_facet.links(cell) == facet)[0]
    return pairs
