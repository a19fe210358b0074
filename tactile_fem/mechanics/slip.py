"""What sticking skin remembers: its elastic slip, at each contact quadrature point.

Nitsche's method holds sticking skin with ``t_t - gamma_h slip``. The tissue's traction `t_t` that
it carries from step to step is exact only to the order of the mesh, so slip counted from the last
step alone would let the skin creep by that error in every step. As in the return mapping of
plasticity, slip counts from where the skin began to stick: the elastic slip

    e = (t_t - s_t)/gamma_h

of the last accepted step is added to that of the present one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import ufl
from dolfinx import fem
from scipy.spatial import cKDTree

from tactile_fem.mechanics.obstacle import Obstacle

if TYPE_CHECKING:
    from tactile_fem.mechanics.problem import FingerProblem

_SAME_POINT_MM = 1e-6


class ElasticSlip:
    """Elastic slip of the last accepted step.

    Parameters
    ----------
    obstacle
        Its quadrature points are used.

    Attributes
    ----------
    old
        The slip as a quadrature function, in mm; for use in forms.
    """

    def __init__(self, obstacle: Obstacle) -> None:
        self._obstacle = obstacle
        self.old = obstacle.quadrature_function((3,))

    def compile(self, problem: FingerProblem) -> None:
        """Prepare `keep` for a problem whose contact uses `old`."""
        # Tested with the quadrature element, a form is the value at each point times its weight.
        at_points = ufl.TestFunction(self.old.function_space)
        slip = one = 0
        for part in problem.skin:
            value = part.contact.elastic_slip(part.t, problem.u, problem.u_old)
            slip += ufl.dot(value, at_points) * part.ds
            one += sum(at_points[i] for i in range(3)) * part.ds
        self._form = problem.compile(slip)
        weight = fem.assemble_vector(problem.compile(one)).array
        self._weight = np.where(weight > 0, weight, np.inf)  # of other ranks' facets

    def keep(self) -> None:
        """Remember the elastic slip of the present state, before it becomes the old one."""
        self._obstacle.refresh()
        self.old.x.array[:] = fem.assemble_vector(self._form).array / self._weight

    def gather(self) -> np.ndarray:
        """Return undeformed places and slips (n, 6) in mm of all points that stick or slide."""
        slip = self.old.x.array.reshape(-1, 3)
        touching = np.any(slip != 0, axis=1)
        here = np.hstack([self._obstacle.points_mm[touching], slip[touching]])
        return np.concatenate(self._obstacle.comm.allgather(here))

    def scatter(self, saved: np.ndarray) -> None:
        """Set the slip from what `gather` returned, on any number of ranks."""
        slip = self.old.x.array.reshape(-1, 3)
        slip[:] = 0.0
        points = self._obstacle.points_mm
        if len(points) and len(saved):
            distance, place = cKDTree(points).query(saved[:, :3])
            mine = distance < _SAME_POINT_MM
            slip[place[mine]] = saved[mine, 3:]
