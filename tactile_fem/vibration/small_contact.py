"""Contact under small motions about an accepted state, in UFL: linear, with that state's contact.

What touches goes on touching and what does not stays free; what sticks goes on sticking, and what
slides goes on in its direction with Coulomb's friction. With `m` the motion of the skin relative to
the body, ``dt`` the change of the tissue's traction and `H` the curvature of the body,

    ds_n = c (dt.nu - gamma_h m.nu),    dnu = H m                    where s_n > 0
    ds_t = (dt - gamma_h m)_t                                        where it sticks
    ds_t = mu ds_n s_t/|s_t|                                         where it slides

`c` is 1 but where the onset of contact is rounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from tactile_fem.mechanics.contact_law import ContactLaw
from tactile_fem.mechanics.terms.contact import Contact

# Share of Coulomb's bound from which on skin slides.
_SLIDES = 0.99
_TINY_MPa = 1e-12


@dataclass(frozen=True)
class Touch:
    """The contact of the accepted state at the quadrature points.

    Attributes
    ----------
    pressure, friction
        In MPa.
    closed
        How pressure grows with what would be pressure were the contact not rounded, 0 to 1.
    """

    pressure: fem.Function
    closed: fem.Function
    friction: fem.Function

    @classmethod
    def of(cls, contact: Contact) -> Touch:
        """Read it at the accepted state, which the forms have to be at."""
        obstacle = contact.obstacle
        scalars = [obstacle.quadrature_function(()) for _ in range(2)]
        touch = cls(*scalars, obstacle.quadrature_function(obstacle.u.ufl_shape))
        for function, values in (
            (touch.pressure, contact.at_points(lambda part: part.law.s_n)),
            (touch.closed, contact.at_points(lambda part: part.law.closed())),
            (touch.friction, contact.at_points(lambda part: _transmitted(part.law))),
        ):
            found = values.read()
            function.x.array[: len(found)] = found
        return touch

    def change(self, law: ContactLaw, dt: Expr, motion: Expr) -> Expr:
        """Return how the traction `s` on the finger changes.

        Parameters
        ----------
        law
            That of the skin.
        dt
            Change of the tissue's traction, MPa.
        motion
            Of the skin relative to the body, mm.
        """
        nu, stiffness = law.obstacle.normal, law.stiffness
        q = dt - stiffness * motion
        ds_n = self.closed * ufl.dot(q, nu)
        size = ufl.sqrt(ufl.dot(self.friction, self.friction) + _TINY_MPa**2)
        slides = ufl.ge(size, _SLIDES * law.friction * self.pressure)
        follows = law.friction * ds_n * self.friction / size
        ds_t = ufl.conditional(slides, follows, law.tangential(q))
        ds = ds_n * nu + self.pressure * (law.obstacle.hessian * motion) + ds_t
        return ufl.conditional(ufl.gt(self.pressure, 0.0), ds, 0.0 * ds)


def _transmitted(law: ContactLaw) -> Expr:
    """Return the friction that the last accepted step ended with, in MPa; see `terms.contact`."""
    return law.tangential(law.t) - law.untransmitted_old
