"""The history of sticking skin at each contact quadrature point.

Nitsche's method holds sticking skin with ``t_t - gamma_h slip``. The tissue's traction `t_t` has a
discretization error. If slip were measured from the last step only, the skin would creep by this
error in every step. As in the return mapping of plasticity, slip is therefore measured from where
the skin began to stick: the part of the traction that the contact did not transmit in the last
accepted step,

    d = t_t - s_t        (gamma_h times the elastic slip),

is subtracted in the present step. Since it is a traction, it remains valid if `gamma_h` changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem

from tactile_fem.mechanics.contact import SkinPart
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.mechanics.state import PointHistory


class StickMemory(PointHistory):
    """Tangential traction that the contact did not transmit in the last accepted step, in MPa.

    Parameters
    ----------
    obstacle
        Its quadrature points are used.
    """

    def __init__(self, obstacle: Obstacle) -> None:
        self._obstacle = obstacle
        old = obstacle.quadrature_function(obstacle.u.ufl_shape)
        super().__init__("unmatched_MPa", old, obstacle.comm)

    def compile(
        self,
        skin: Sequence[SkinPart],
        u_old: fem.Function,
        compile_: Callable[[ufl.Form], fem.Form],
    ) -> None:
        """Compile `present` for skin whose contact uses `old`."""
        u = self._obstacle.u
        # Tested with the quadrature element, a form is the value at each point times its weight.
        at_points = ufl.TestFunction(self.old.function_space)
        d = one = 0
        for part in skin:
            value = part.contact.unmatched(part.t, u, u_old)
            d += ufl.dot(value, at_points) * part.ds
            one += sum(at_points[i] for i in range(len(at_points))) * part.ds
        self._form = compile_(d)
        weight = fem.assemble_vector(compile_(one)).array
        self._weight = np.where(weight > 0, weight, np.inf)  # of other ranks' facets

    def points_mm(self) -> np.ndarray:
        """Return the undeformed contact quadrature points of this rank, (points, dimension)."""
        return self._obstacle.points_mm

    def present(self) -> np.ndarray:
        """Return the traction that the contact does not transmit at the present state."""
        self._obstacle.refresh()
        return fem.assemble_vector(self._form).array / self._weight
