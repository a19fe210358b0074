"""Sums of powers of the principal stretches, in UFL, with derivatives where stretches coincide.

The eigenvalues of Cbar have none there, but symmetric functions of them have: away from rest, in
closed form, by the eigenvalue that is farthest from the other two, which is smooth where these
coincide, and by their product and sum; at rest, where all three do, by a series.
"""

from __future__ import annotations

from typing import Any

import ufl
from ufl.core.expr import Expr

# Up to where series are used, and terms of one. With exponents of up to 50 second derivatives of
# series and closed form are exact to 1e-8 there, with usual ones to 1e-10.
_NEAR_ONE, _NEAR_REST, _TERMS = 1e-4, 1e-6, 6


def chebyshev(order: Any, x: Expr, *, rises: bool = True) -> Expr:
    """Return ``cosh(order acosh x)``, for x from 1 on, or ``cos(order acos x)``, up to 1."""
    near = ufl.as_ufl(1.0)
    for k in reversed(range(_TERMS)):  # the hypergeometric series 2F1(-order, order; 1/2; (1-x)/2)
        near = 1 + near * (1 - x) * ((k**2 - order**2) / ((2 * k + 1) * (k + 1)))
    is_near = ufl.lt(abs(x - 1), _NEAR_ONE)
    away = ufl.conditional(is_near, 2.0 if rises else 0.5, x)
    if rises:
        far = ufl.cosh(order * ufl.ln(away + ufl.sqrt(away**2 - 1)))
    else:
        far = ufl.cos(order * ufl.acos(away))
    return ufl.conditional(is_near, near, far)


def sum_of_powers(a: Expr, b: Expr, exponent: Any) -> Expr:
    """Return the sum of ``lambdabar_i^exponent``, given ``I1bar - 3`` and ``I2bar - 3``."""
    half, mean = exponent / 2, 1 + a / 3
    # Invariants of the deviator of Cbar / mean, whose eigenvalues solve e^3 = second e + third.
    second = (2 * a - b + a**2 / 3) / mean**2
    third = (a - b - a * b / 3 + 2 * a**2 / 3 + 2 * a**3 / 27) / mean**3
    near = 3 + half * (half - 1) * (
        second
        + (half - 2) / 2 * third
        + (half - 2) * (half - 3) / 12 * (second**2 + (half - 4) / 2 * second * third)
    )
    is_near = ufl.lt(second, 3 * _NEAR_REST)
    radius = ufl.sqrt(ufl.conditional(is_near, 1.0, second / 3))
    cosine = ufl.conditional(is_near, 0.5, third / (2 * radius**3))
    side = ufl.conditional(ufl.lt(cosine, 0), -1.0, 1.0)  # of the eigenvalue that is alone
    alone = mean * (1 + 2 * side * radius * chebyshev(1 / 3, side * cosine, rises=False))
    both = (3 * mean - alone) * ufl.sqrt(alone) / 2  # mean of the others over that of their roots
    far = alone**half + 2 * alone ** (-half / 2) * chebyshev(half, both)
    return ufl.conditional(is_near, mean**half * near, far)
