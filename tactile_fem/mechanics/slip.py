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
from dolfinx import fem
from ufl.form import Form

from tactile_fem.mechanics.contact import SkinPart
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.mechanics.point_values import PointValues
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
        compile_: Callable[[Form], fem.Form],
    ) -> None:
        """Compile `present` for skin whose contact uses `old`."""
        u = self._obstacle.u
        unmatched = [(part.contact.unmatched(part.t, u, u_old), part.ds) for part in skin]
        self._unmatched = PointValues(self._obstacle, unmatched, compile_)

    def points_mm(self) -> np.ndarray:
        """Return the undeformed contact quadrature points of this rank, (points, dimension)."""
        return self._obstacle.points_mm

    def present(self) -> np.ndarray:
        """Return the traction that the contact does not transmit at the present state."""
        return self._unmatched.read()
