"""Inertia in time: the generalized-alpha method with all forces at the end of the step.

Over a step `dt` from ``u_n, v_n, a_n`` (Newmark 1959),

    u = u_n + dt v_n + dt^2 ((1/2 - beta) a_n + beta a),    v = v_n + dt ((1 - gamma) a_n + gamma a)

and the virtual work of stresses and contact at the end of the step is balanced by that of

    rho ((1 - alpha) a + alpha a_n),    alpha = (r - 1)/(r + 1),
    gamma = 1/2 - alpha,    beta = (1 - alpha)^2/4.

This is the method of Chung and Hulbert (1993, J. Appl. Mech. 60:371, DOI 10.1115/1.2900803) with
their ``alpha_f = 0``, that of Wood, Bossak and Zienkiewicz (1980, Int. J. Numer. Meth. Eng.
15:1562). It is of second order and, in linear problems, stable for steps of any length; `r` is the
spectral radius at infinite frequency. Forces are not averaged because contact and the histories of
the tissues are those of the end of a step: there the skin may not be inside the body, and the same
residual and load serve with and without inertia.

Displacements are relative to the bone, which may turn about its joint. All motion here is that in
space: over a step whose bone swings by a rotation `Q` and ``t``, tissue at ``y = X + u`` moves by

    Q y + t - y_n,

seen from the bone of the last accepted step. That holds the accelerations of Euler, Coriolis and
the centrifugal one, for any angle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh
from numpy.typing import ArrayLike
from ufl.core.expr import Expr

from tactile_fem.assembly.compile import Constant, expression, jit_options
from tactile_fem.mechanics.state import PointHistory
from tactile_fem.mechanics.terms.term import Term
from tactile_fem.mechanics.tissues import Tissues
from tactile_fem.study import Solver

# `r` above. With 24 steps in a period inertia is 2.5 % too large; oscillations too fast for the
# steps are gone after a few of them. At 1 it is 1.2 % too large, and fast oscillations stay.
SPECTRAL_RADIUS = 0.5
# kg/m3 in the unit of mass that goes with mm, N and s.
_T_PER_MM3 = 1e-12


def moment_of_inertia(tissues: Tissues, density_kg_m3: float, point_mm: ArrayLike) -> float:
    """Return that of the undeformed tissues, in N mm s2; all ranks call.

    It is about the line along X through a point, (3,).
    """
    msh = tissues.domain.mesh
    r = tissues.at.X - Constant(msh, np.asarray(point_mm))
    density = mass_density(msh, density_kg_m3)
    form = fem.form(density * (r[1] ** 2 + r[2] ** 2) * tissues.dx, jit_options=jit_options(()))
    return float(tissues.domain.comm.allreduce(fem.assemble_scalar(form)))


def mass_density(msh: mesh.Mesh, density_kg_m3: float) -> Constant:
    """Return a density in t/mm3."""
    return Constant(msh, density_kg_m3 * _T_PER_MM3)


class GeneralizedAlpha:
    """The method's formulas, of numbers as of UFL expressions; see the top of this module.

    Parameters
    ----------
    spectral_radius
        `r`.
    """

    def __init__(self, spectral_radius: float = SPECTRAL_RADIUS) -> None:
        self.alpha = (spectral_radius - 1) / (spectral_radius + 1)
        self.gamma, self.beta = 1 / 2 - self.alpha, (1 - self.alpha) ** 2 / 4

    def acceleration(self, moved: Any, v_old: Any, a_old: Any, dt: Any) -> Any:
        """Return `a` where a step moves by `moved`."""
        beta = self.beta
        return (moved - dt * v_old) / (beta * dt**2) - (1 / (2 * beta) - 1) * a_old

    def velocity(self, a: Any, v_old: Any, a_old: Any, dt: Any) -> Any:
        """Return `v` at the end of the step."""
        return v_old + dt * ((1 - self.gamma) * a_old + self.gamma * a)

    def averaged(self, a: Any, a_old: Any) -> Any:
        """Return the acceleration that is balanced."""
        return (1 - self.alpha) * a + self.alpha * a_old


class Inertia(Term):
    """Mass of the tissues between two states.

    Parameters
    ----------
    tissues
        Their motion and density; a finger begins at rest.
    spectral_radius
        Share of infinitely fast oscillations that a step keeps, 0 to 1.

    Attributes
    ----------
    velocity, acceleration
        In space at the end of the step, seen from the bone at its beginning, mm/s and mm/s2.
    """

    is_symmetric = True

    def __init__(self, tissues: Tissues, spectral_radius: float = SPECTRAL_RADIUS) -> None:
        super().__init__(tissues)
        self._state = state = tissues.state
        u, u_old, dt = tissues.u, state.u_old, state.time_step
        msh, dim = u.function_space.mesh, len(u)
        old = fem.Function(fem.functionspace(msh, ("Lagrange", 2, (2 * dim,))))
        v_old = ufl.as_vector([old[i] for i in range(dim)])
        a_old = ufl.as_vector([old[dim + i] for i in range(dim)])
        self._density = mass_density(msh, tissues.constants.density_kg_m3)
        method = GeneralizedAlpha(spectral_radius)
        y = ufl.SpatialCoordinate(msh) + u
        a = method.acceleration(u - u_old + state.swung(y), v_old, a_old, dt)
        self.acceleration: Expr = a
        self.velocity: Expr = method.velocity(a, v_old, a_old, dt)
        self._averaged = method.averaged(a, a_old)
        against_bone = method.acceleration(u - u_old, v_old, a_old, dt)
        self._averaged_against_bone = method.averaged(against_bone, a_old)
        self._per_mm = self._density * (1 - method.alpha) / (method.beta * dt**2)
        motion = [state.seen_from_bone(vector) for vector in (self.velocity, a)]
        self.histories = [_Motion(old, *motion)]

    @classmethod
    def of(cls, tissues: Tissues, solver: Solver) -> list[Inertia]:
        """Return the term, if mass counts; otherwise the finger is always in equilibrium."""
        return [cls(tissues)] if solver.inertia else []

    def residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work of the mass times its acceleration in `v`."""
        averaged = self._state.seen_from_bone(self._averaged)
        return self._density * ufl.inner(averaged, v) * self.tissues.dx

    def work_of_tangent(self, v: Expr) -> ufl.Form:
        """Return the virtual work at a fixed bone; the swing does not enter the tangent."""
        return self._density * ufl.inner(self._averaged_against_bone, v) * self.tissues.dx

    def static_residual(self, v: Expr) -> ufl.Form:
        """Return nothing."""
        return ufl.Form([])

    def skin_stiffness(self, tissue: str, gamma: Expr, height: Expr) -> Expr:
        """Return how stiff mass makes a layer of that height over the step, MPa/mm.

        The incomplete variant of Nitsche's method has a tangent that is not symmetric: without
        this addition, skin in contact flutters where steps are shorter than the time that waves
        take through its elements.
        """
        return self._per_mm * height


class _Motion(PointHistory):
    """Velocity and acceleration of the nodes, mm/s and mm/s2."""

    def __init__(self, old: fem.Function, velocity: Expr, acceleration: Expr) -> None:
        super().__init__("motion", old, old.function_space.mesh.comm)
        both = ufl.as_vector([*velocity, *acceleration])
        self._present = expression(both, old.function_space.element.interpolation_points)
        self._at_nodes = fem.Function(old.function_space)

    def points_mm(self) -> np.ndarray:
        """Return the undeformed nodes of this rank, (nodes, dimension)."""
        V = self.old.function_space
        return V.tabulate_dof_coordinates()[:, : V.mesh.geometry.dim]

    def present(self) -> np.ndarray:
        """Return velocity and acceleration at the present state, as `old` holds them."""
        self._at_nodes.interpolate(self._present)
        return self._at_nodes.x.array.copy()
