"""Nitsche's method for frictional contact with a rigid body, in UFL.

After Chouly, Mlika and Renard (Numer. Math. 2018) and, at large deformation, Mlika, Renard and
Chouly (Comput. Methods Appl. Mech. Eng. 2017), for one deformable body. With the Piola
traction ``t = P N`` on the finger, the obstacle's outward normal `nu`, ``p = t.nu`` (compression
positive) and ``t_t = t - p nu``:

    s_n = [p - gamma_h g]_+                                 non-penetration, smoothed
    s_t = Coulomb(t_t - d_old - gamma_h slip; mu s_n)       friction, see `terms.contact`
    residual -= Int s.v + theta/gamma_h (t - s).Dt[v] dA,   s = s_n nu + s_t

`mu` may depend on pressure, slip speed and place, see `tactile_fem.stimulus.friction`.
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl
from ufl.core.expr import Expr

from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.stimulus import Friction

# Keeps the friction law differentiable where neither pressure nor slip acts, in MPa.
_TINY_MPa = 1e-12
_TINY_MM = 1e-9
# Where the smoothed positive part is zero, in widths.
ZERO_BELOW = 250
# Share of Coulomb's bound over which sticking turns to sliding.
_TRANSITION = 0.2


def smooth_positive(x: Expr, width: Expr | float) -> Expr:
    """Return ``[x]_+`` with its kink rounded over the pressure `width`.

    The rounding acts over a gap of ``width/gamma_h``, less than a micrometre. This does not change
    the result, but Newton's method converges although points of the skin open and close. A
    thousandth of the width is subtracted, so that the value is exactly zero far from the body.
    """
    rounded = (x + ufl.sqrt(x**2 + width**2 + _TINY_MPa**2)) / 2
    return ufl.max_value(rounded - width / 1000, 0.0)


def smooth_coulomb(q: Expr, bound: Expr, softness: Expr | float) -> Expr:
    """Return the trial traction `q`, limited to Coulomb's `bound`.

    This is the projection onto a disc of radius `bound`, with its edge rounded by a parabola. Up
    to 0.8 of the bound the result is `q` itself, so that sticking skin does not creep from step to
    step; from 1.2 of the bound on it is the bound. A `softness` of 1 rounds more, to
    ``bound q/sqrt(|q|^2 + bound^2)``; values between mix the two. With it Newton's method
    converges where sticking changes to sliding.
    """
    size = ufl.sqrt(ufl.dot(q, q) + _TINY_MPa**2)
    rounded = bound - ((1 + _TRANSITION) * bound - size) ** 2 / (
        4 * _TRANSITION * (bound + _TINY_MPa)
    )
    sliding = ufl.conditional(ufl.ge(size, (1 + _TRANSITION) * bound), bound, rounded)
    sharp = ufl.conditional(ufl.le(size, (1 - _TRANSITION) * bound), size, sliding)
    soft = bound * size / ufl.sqrt(size**2 + bound**2)
    return (sharp + softness * (soft - sharp)) * q / size


@dataclass(frozen=True)
class ContactLaw:
    """Traction between the finger and a rigid body, on skin of one tissue.

    Parameters
    ----------
    obstacle
        Supplies gap, normal and the body's motion.
    t
        Piola traction of the tissue, MPa.
    u, u_old
        Displacement now and at the last accepted step, mm.
    friction
        Law of friction.
    local
        What it knows of the place on the body.
    area_stretch
        Deformed over undeformed area of the skin.
    stiffness
        ``gamma_h`` in MPa/mm.
    width
        Pressure over which contact sets in, in MPa.
    softness
        Regularization of friction, 0 to 1; see `smooth_coulomb`.
    untransmitted_old
        ``d = t_t - s_t`` of the last accepted step, MPa; see `tactile_fem.mechanics.terms.contact`.
    theta
        0 incomplete, 1 symmetric, -1 skew-symmetric Nitsche.
    """

    obstacle: Obstacle
    t: Expr
    u: Expr
    u_old: Expr
    friction: Friction
    local: Expr | None
    area_stretch: Expr
    stiffness: Expr | float
    width: Expr | float
    softness: Expr | float
    untransmitted_old: Expr
    theta: int = 0

    def tangential(self, vector: Expr) -> Expr:
        """Return a vector without its component along the normal."""
        nu = self.obstacle.normal
        return vector - ufl.dot(vector, nu) * nu

    @property
    def s_n(self) -> Expr:
        """Pressure on the finger, MPa."""
        p = ufl.dot(self.t, self.obstacle.normal)
        return smooth_positive(p - self.stiffness * self.obstacle.gap, self.width)

    @property
    def slip(self) -> Expr:
        """Motion of the skin relative to the body in the step, mm."""
        advance = self.obstacle.state.advance(self.obstacle.position + self.u_old)
        return (self.u - self.u_old) - advance

    def coefficient(self, s_n: Expr) -> Expr:
        """Return the coefficient of friction at a pressure."""
        slip = self.tangential(self.slip)
        speed = ufl.sqrt(ufl.dot(slip, slip) + _TINY_MM**2) / self.obstacle.state.time_step
        return self.friction.coefficient_at(s_n / self.area_stretch, speed, self.local)

    def bound_slope(self) -> Expr:
        """Return how the bound of friction grows with the pressure at a given slip and place."""
        s_n = ufl.variable(self.s_n)
        return ufl.diff(self.coefficient(s_n) * s_n, s_n)

    @property
    def s_t(self) -> Expr:
        """Friction on the finger, MPa."""
        stuck = self.obstacle.state.turned(self.untransmitted_old)
        trial = self.tangential(self.t - stuck - self.stiffness * self.slip)
        return smooth_coulomb(trial, self.coefficient(self.s_n) * self.s_n, self.softness)

    def closed(self) -> Expr:
        """Return how `s_n` grows with ``p - gamma_h g``, 0 to 1; see `smooth_positive`."""
        p = ufl.dot(self.t, self.obstacle.normal)
        x = ufl.variable(p - self.stiffness * self.obstacle.gap)
        return ufl.diff(smooth_positive(x, self.width), x)

    def untransmitted(self) -> Expr:
        """Return ``d = t_t - s_t`` in MPa; zero without contact."""
        d = self.tangential(self.t) - self.s_t
        return ufl.conditional(ufl.gt(self.s_n, 0.0), d, 0.0 * d)

    def residual(self, v: Expr) -> Expr:
        """Return the contact part of the residual's integrand over the skin."""
        s = self.s_n * self.obstacle.normal + self.s_t
        residual = -ufl.dot(s, v)
        if self.theta:
            Dt = ufl.derivative(self.t, self.u, v)
            residual -= self.theta / self.stiffness * ufl.dot(self.t - s, Dt)
        return residual
