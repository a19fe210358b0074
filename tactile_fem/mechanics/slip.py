"""What sticking skin remembers, at each contact quadrature point.

Nitsche's method holds sticking skin with ``t_t - gamma_h slip``. The tissue's traction `t_t` that
it carries from step to step is exact only to the order of the mesh, so slip counted from the last
step alone would let the skin creep by that error in every step. As in the return mapping of
plasticity, slip counts from where the skin began to stick: what the contact did not take of the
traction in the last accepted step,

    d = t_t - s_t        (gamma_h times the elastic slip),

is left out in the present one. As a traction it stays right when `gamma_h` changes between steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem
from scipy.spatial import cKDTree

from tactile_fem.mechanics.contact import SkinPart
from tactile_fem.mechanics.obstacle import Obstacle

_SAME_POINT_MM = 1e-6


class StickMemory:
    """Tangential traction that the contact did not take in the last accepted step.

    Parameters
    ----------
    obstacle
        Its quadrature points are used.

    Attributes
    ----------
    old
        It as a quadrature function, in MPa; for use in forms.
    """

    def __init__(self, obstacle: Obstacle) -> None:
        self._obstacle = obstacle
        self.old = obstacle.quadrature_function((3,))

    def compile(
        self,
        skin: Sequence[SkinPart],
        u_old: fem.Function,
        compile_: Callable[[ufl.Form], fem.Form],
    ) -> None:
        """Prepare `accept` for skin whose contact uses `old`."""
        u = self._obstacle.u
        # Tested with the quadrature element, a form is the value at each point times its weight.
        at_points = ufl.TestFunction(self.old.function_space)
        d = one = 0
        for part in skin:
            value = part.contact.unmatched(part.t, u, u_old)
            d += ufl.dot(value, at_points) * part.ds
            one += sum(at_points[i] for i in range(3)) * part.ds
        self._form = compile_(d)
        weight = fem.assemble_vector(compile_(one)).array
        self._weight = np.where(weight > 0, weight, np.inf)  # of other ranks' facets

    def accept(self) -> None:
        """Remember the present state, before it becomes the old one."""
        self._obstacle.refresh()
        self.old.x.array[:] = fem.assemble_vector(self._form).array / self._weight

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Return undeformed places (mm) and tractions (MPa), (n, 6), of all points that touch.

        `values` are those of `old`, now or at an earlier step.
        """
        d = values.reshape(-1, 3)
        touching = np.any(d != 0, axis=1)
        here = np.hstack([self._obstacle.points_mm[touching], d[touching]])
        return np.concatenate(self._obstacle.comm.allgather(here))

    def scatter(self, saved: np.ndarray) -> None:
        """Remember what `gather` returned, on any number of ranks."""
        d = self.old.x.array.reshape(-1, 3)
        d[:] = 0.0
        points = self._obstacle.points_mm
        if len(points) and len(saved):
            distance, place = cKDTree(points).query(saved[:, :3])
            mine = distance < _SAME_POINT_MM
            d[place[mine]] = saved[mine, 3:]
