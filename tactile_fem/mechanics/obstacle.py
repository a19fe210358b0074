"""A rigid body of any shape in UFL, by the second-order expansion of its signed distance.

The signed distance `g`, its gradient and its Hessian are evaluated at each contact quadrature
point at the current iterate `u0`. The form uses ``g + n.(u-u0) + (u-u0).H.(u-u0)/2``, so UFL's
derivative at ``u = u0`` is the exact tangent. The data are refreshed before each residual and
each Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr

from tactile_fem.assembly.compile import expression, jit_options
from tactile_fem.assembly.facets import FacetPoints
from tactile_fem.assembly.tags import with_shared_tags
from tactile_fem.mechanics.state import State
from tactile_fem.runtime.ranks import shared_errors
from tactile_fem.stimulus.body import EXCESS_MM, NEAR_MM, RigidBody
from tactile_fem.stimulus.friction import OverBody
from tactile_fem.study import Solver

# Added to the length of gradients, which may vanish.
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
    solver
        Quadrature degree on the facets, and the compiler's flags.

    Attributes
    ----------
    state
        Pose of the body, now and at the last accepted step.
    gap, normal, hessian
        UFL expressions of the signed distance, of the outward normal and of the distance's second
        derivatives.
    position
        UFL expression of the undeformed position, mm.
    entity_maps
        To be given to the compiler of any form that uses these expressions.
    facet_points
        The contact quadrature points on the facets of this rank, ghosts included.
    """

    def __init__(self, body: RigidBody, state: State, facets: np.ndarray, solver: Solver) -> None:
        self._jit = jit_options(solver.compiler_flags)
        self.body = body
        self.u = u = state.u
        parent = u.function_space.mesh
        self._at: tuple[np.ndarray, ...] = ()  # displacement and place at the last expansion
        self._margin_mm: np.ndarray | None = None  # of a facet's gap beyond its reach
        self.state = state
        dim = parent.topology.dim
        submesh, entity_map = mesh.create_submesh(parent, dim - 1, facets)[:2]
        self.entity_maps: Sequence[mesh.EntityMap] = [entity_map]

        self._parent, self._submesh, self._degree = parent, submesh, solver.contact_degree
        self.position: Expr = ufl.SpatialCoordinate(parent)
        self._gap = self.quadrature_function(())
        self.facet_points = FacetPoints(self._gap.function_space, parent, self.entity_maps)
        self._displacement = expression(u, self.facet_points.points)
        self._normal = self.quadrature_function((dim,))
        self.hessian = self.quadrature_function((dim, dim))
        self._base = self.quadrature_function((dim,))
        self._fields: list[tuple[OverBody, fem.Function, fem.Function]] = []
        du = u - self._base
        self.gap: Expr = self._gap + ufl.dot(self._normal, du) + ufl.dot(du, self.hessian * du) / 2
        gradient = self._normal + self.hessian * du
        # Unit already, but where two surfaces are blended; none where several are equally far.
        self.normal: Expr = gradient / ufl.sqrt(ufl.dot(gradient, gradient) + _ZERO**2)

    def over_body(self, field: OverBody) -> Expr:
        """Return a value over the body in UFL, by its expansion to first order, as the gap's."""
        value, gradient = map(self.quadrature_function, ((), (len(self.u),)))
        self._fields.append((field, value, gradient))
        return value + ufl.dot(gradient, self.u - self._base)

    def compile(self, form: ufl.Form) -> fem.Form:
        """Compile a form that may use the body."""
        shared = with_shared_tags(form)
        return fem.form(shared, jit_options=self._jit, entity_maps=self.entity_maps)

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

    @property
    def points_mm(self) -> np.ndarray:
        """Return the undeformed contact quadrature points of this rank, (n, dimension)."""
        return self.facet_points.places.reshape(-1, self._parent.geometry.dim)

    @property
    def gap_mm(self) -> np.ndarray:
        """The signed distance as it was last expanded, (facets, points)."""
        return self._gap.x.array.reshape(-1, len(self.facet_points.points))

    def evaluate_everywhere(self) -> None:
        """Expand the distance of all facets at the next `refresh`."""
        self._margin_mm, self._at = None, ()

    def skip_distant(self, reach_mm: np.ndarray) -> None:
        """Skip facets at `refresh` until they may have come within reach or the body has moved.

        A facet that moves by less than its margin stays out of reach: see `RigidBody`.

        Parameters
        ----------
        reach_mm
            Gap below which a facet has to be evaluated, (facets,).
        """
        relied_on = np.minimum(self.gap_mm.min(axis=1), NEAR_MM)
        self._margin_mm = relied_on - EXCESS_MM - reach_mm
        self._displacement_then = self._base.x.array.copy()

    def refresh(self) -> None:
        """Expand the signed distance anew at the current displacement; all ranks must call."""
        with shared_errors(self.comm):  # a user's own body may fail on one of them
            self._refresh()

    def _refresh(self) -> None:
        if not len(self.gap_mm):
            return
        place, R = self.state.translation.value, self.state.rotation
        now = self.u.x.array, place, R
        if self._at and all(map(np.array_equal, now, self._at)):
            return  # the Jacobian follows a residual at the same place
        if self._at and not all(map(np.array_equal, now[1:], self._at[1:])):
            self._margin_mm = None
        u = self.facet_points.evaluate(self._displacement)
        near = self._may_be_near(u)
        y = (self.facet_points.places[near] + u[near] - place) @ R
        if len(y):
            points = y.reshape(-1, y.shape[-1])
            d = self.body.distance(points)
            _set(self._gap, near, d.gap)
            _set(self._normal, near, d.normal @ R.T)
            _set(self.hessian, near, _turned(d.hessian, R))
            _set(self._base, near, u[near])
            for field, value, gradient in self._fields:
                values, gradients = field(points)
                _set(value, near, values)
                _set(gradient, near, gradients @ R.T)
        self._at = tuple(values.copy() for values in now)

    def _may_be_near(self, u: np.ndarray) -> np.ndarray:
        """Return which facets the body may be near, all if that is not known; (facets,)."""
        if self._margin_mm is None:
            return np.ones(len(u), dtype=bool)
        moved = u - self._displacement_then.reshape(u.shape)
        moved_mm = np.sqrt(np.einsum("fpi,fpi->fp", moved, moved).max(axis=1))
        return self._margin_mm < moved_mm


class PointValues:
    """Evaluates an expression of the contact at its quadrature points.

    Parameters
    ----------
    obstacle
        Its quadrature points are used.
    values
        The expression on each part of the skin, with the part's measure; all of one shape, which
        is that of a vector or a scalar.
    """

    def __init__(
        self,
        obstacle: Obstacle,
        values: Sequence[tuple[Expr, ufl.Measure]],
    ) -> None:
        self._obstacle = obstacle
        shape = values[0][0].ufl_shape
        # Tested with the quadrature element, a form is the value at each point times its weight.
        at_points = ufl.TestFunction(obstacle.quadrature_function(shape).function_space)
        entries = [at_points[i] for i in range(len(at_points))] if shape else [at_points]
        self._form = obstacle.compile(sum(ufl.inner(value, at_points) * ds for value, ds in values))
        one = obstacle.compile(sum(sum(entries) * ds for _, ds in values))
        weight = fem.assemble_vector(one).array
        self._weight = np.where(weight > 0, weight, np.inf)  # of other ranks' facets

    def read(self) -> np.ndarray:
        """Return the values at the present state as an array of a quadrature function."""
        self._obstacle.refresh()
        return fem.assemble_vector(self._form).array / self._weight


def _turned(symmetric: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return ``R H R.T`` of symmetric matrices H (n, d, d)."""
    half = (symmetric.reshape(-1, len(R)) @ R.T).reshape(symmetric.shape)
    return half.swapaxes(1, 2).reshape(-1, len(R)) @ R.T


def _set(function: fem.Function, facets: np.ndarray, values: np.ndarray) -> None:
    """Set a quadrature function on some facets."""
    function.x.array.reshape(len(facets), -1)[facets] = values.reshape(facets.sum(), -1)
