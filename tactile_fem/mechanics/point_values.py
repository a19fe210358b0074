"""Values of an expression at each contact quadrature point."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from tactile_fem.mechanics.obstacle import Obstacle


class PointValues:
    """Evaluates an expression of the contact at its quadrature points.

    Parameters
    ----------
    obstacle
        Its quadrature points are used.
    values
        The expression on each part of the skin, with the part's measure; all of one shape, which
        is that of a vector or a scalar.
    compile_
        Compiles a form that uses the obstacle.
    """

    def __init__(
        self,
        obstacle: Obstacle,
        values: Sequence[tuple[Expr, ufl.Measure]],
        compile_: Callable[[ufl.Form], fem.Form],
    ) -> None:
        self._obstacle = obstacle
        shape = values[0][0].ufl_shape
        # Tested with the quadrature element, a form is the value at each point times its weight.
        at_points = ufl.TestFunction(obstacle.quadrature_function(shape).function_space)
        entries = [at_points[i] for i in range(len(at_points))] if shape else [at_points]
        self._form = compile_(sum(ufl.inner(value, at_points) * ds for value, ds in values))
        one = compile_(sum(sum(entries) * ds for _, ds in values))
        weight = fem.assemble_vector(one).array
        self._weight = np.where(weight > 0, weight, np.inf)  # of other ranks' facets

    def read(self) -> np.ndarray:
        """Return the values at the present state as an array of a quadrature function."""
        self._obstacle.refresh()
        return fem.assemble_vector(self._form).array / self._weight
