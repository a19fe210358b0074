"""Inertia in time: the generalized-alpha method with all forces at the end of the step.

Over a step `dt` from ``u_n, v_n, a_n`` (Newmark 1959),

    u = u_n + dt v_n + dt^2 ((1/2 - beta) a_n + beta a),    v = v_n + dt ((1 - gamma) a_n + gamma a)

and the virtual work of stresses and contact at the end of the step is balanced by that of

    rho ((1 - alpha) a + alpha a_n),    alpha = (r - 1)/(r + 1),
    gamma = 1/2 - alpha,    beta = (1 - alpha)^2/4.

This is the method of Chung and Hulbert (1993, J. Appl. Mech. 60:371, DOI 10.1115/1.2900803) with
their ``alpha_f = 0``, that of Wood, Bossak and Zienkiewicz (1980, Int. J. Numer. Meth. Eng.
15:1562). It is of second order and, in linear problems, stable for steps of any length; `r` is the
share of infinitely fast oscillations that a step leaves. Forces are not averaged because contact
and the histories of the tissues are those of the end of a step: there the skin may not be inside
the body, and the same residual and load serve with and without inertia.

Displacements are those seen from the bone, which is at rest.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr

from tactile_fem.mechanics.compile import expression
from tactile_fem.mechanics.state import PointHistory, State

# `r` above. With 24 steps in a period inertia is 2.5 % too large; what is too fast for the steps
# is gone after a few of them. At 1 it is 1.2 % too large, and what is too fast stays.
SPECTRAL_RADIUS = 0.5
# kg/m3 in the unit of mass that goes with mm, N and s.
_T_PER_MM3 = 1e-12


def mass_density(msh: mesh.Mesh, density_kg_m3: float) -> fem.Constant:
    """Return a density in t/mm3."""
    return fem.Constant(msh, density_kg_m3 * _T_PER_MM3)


class Inertia(PointHistory):
    """Mass of the tissues between two states; the nodes' velocity and acceleration are its history.

    `old` holds both, in mm/s and mm/s2; a finger begins at rest.

    Parameters
    ----------
    state
        Displacement now and at the last accepted step.
    density_kg_m3
        Of all tissues.
    dx
        Their volume measure.
    spectral_radius
        Share of infinitely fast oscillations that a step leaves, 0 to 1.

    Attributes
    ----------
    velocity, acceleration
        At the end of the step, mm/s and mm/s2.
    """

    def __init__(
        self,
        state: State,
        density_kg_m3: float,
        dx: ufl.Measure,
        spectral_radius: float = SPECTRAL_RADIUS,
    ) -> None:
        u, u_old = state.u, state.u_old
        msh, dim = u.function_space.mesh, len(u)
        W = fem.functionspace(msh, ("Lagrange", 2, (2 * dim,)))
        super().__init__("motion", fem.Function(W), msh.comm)
        v_old = ufl.as_vector([self.old[i] for i in range(dim)])
        a_old = ufl.as_vector([self.old[dim + i] for i in range(dim)])
        self._dx, self._density = dx, mass_density(msh, density_kg_m3)
        self._dt = dt = fem.Constant(msh, 1.0)
        alpha = (spectral_radius - 1) / (spectral_radius + 1)
        gamma, beta = 1 / 2 - alpha, (1 - alpha) ** 2 / 4
        a = (u - u_old - dt * v_old) / (beta * dt**2) - (1 / (2 * beta) - 1) * a_old
        self.acceleration: Expr = a
        self.velocity: Expr = v_old + dt * ((1 - gamma) * a_old + gamma * a)
        self._averaged = (1 - alpha) * a + alpha * a_old
        self._per_mm = self._density * (1 - alpha) / (beta * dt**2)
        both = ufl.as_vector([*self.velocity, *a])
        self._present = expression(both, W.element.interpolation_points)
        self._at_nodes = fem.Function(W)

    def set_time_step(self, dt_s: float) -> None:
        """Set the time between the two states."""
        self._dt.value = dt_s

    def residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work of the mass times its acceleration in `v`."""
        return self._density * ufl.inner(self._averaged, v) * self._dx

    def stiffness(self, height: Expr) -> Expr:
        """Return how stiff mass makes a layer of that height (mm) over the step, in MPa/mm.

        By so much the contact must be stiffer. The incomplete variant of Nitsche's method has a
        tangent that is not symmetric: without the addition skin that touches flutters where steps
        are shorter than waves take through its elements.
        """
        return self._per_mm * height

    def points_mm(self) -> np.ndarray:
        """Return the undeformed nodes of this rank, (nodes, dimension)."""
        V = self.old.function_space
        return V.tabulate_dof_coordinates()[:, : V.mesh.geometry.dim]

    def present(self) -> np.ndarray:
        """Return velocity and acceleration at the present state, as `old` holds them."""
        self._at_nodes.interpolate(self._present)
        return self._at_nodes.x.array.copy()
