"""What a term of the virtual work states.

The virtual work of a finger is the sum of its terms. A new physics, such as gravity, fibres or
active tissue, is one more term: a file of its own, which nothing else has to know.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import ufl
from ufl.core.expr import Expr

from tactile_fem.mechanics.state import PointHistory
from tactile_fem.mechanics.tissues import Tissues


@dataclass(frozen=True)
class Delay:
    """A resistance that follows a strain with a delay, as small vibrations see it.

    Attributes
    ----------
    amount
        Its complex coefficient at an angular frequency, 1/s.
    """

    amount: Callable[[float], complex]


class Term:
    """A term of the virtual work, by default without histories and stored energy.

    Parameters
    ----------
    tissues
        Displacement, tissues and state.

    Attributes
    ----------
    is_symmetric
        Whether the tangent is symmetric, which halves its cost.
    pulls_at_skin
        Whether `stress` belongs to the traction with which Nitsche's method holds the skin.
    histories
        What it carries from step to step.
    delays
        How it follows small vibrations.
    """

    is_symmetric = False
    pulls_at_skin = True
    histories: Sequence[PointHistory] = ()
    delays: Sequence[Delay] = ()

    def __init__(self, tissues: Tissues) -> None:
        self.tissues = tissues

    def residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work in `v`."""
        raise NotImplementedError

    def work_of_tangent(self, v: Expr) -> ufl.Form:
        """Return the virtual work in `v` whose derivative is the tangent.

        A cheaper quadrature than that of `residual` may do.
        """
        return self.residual(v)

    def static_residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work in `v` without that of inertia."""
        return self.residual(v)

    def stress(self, tissue: str) -> Expr | None:
        """Return the first Piola stress in a tissue, MPa, (3, 3)."""

    def energy(self, tissue: str) -> Expr | None:
        """Return the strain energy density that a tissue stores, MPa."""

    def stored(self, w: Expr) -> ufl.Form:
        """Return the stored energy of all tissues, weighted with `w`."""
        form = ufl.Form([])
        for name, dx in self.tissues.parts(self.tissues.dx).items():
            energy = self.energy(name)
            if energy is not None:
                form += energy * w * dx
        return form

    def skin_stiffness(self, tissue: str, gamma: Expr, height: Expr) -> Expr | None:
        """Return the term's contribution to the Nitsche parameter, MPa/mm.

        Parameters
        ----------
        tissue
            Tissue at the surface.
        gamma, height
            Nitsche's constant, and height of the cell behind the facet, mm.
        """

    def begin_step(self) -> None:
        """Adopt the state's time step; called before a step is solved."""

    def freeze(self, delay: Delay | None) -> None:
        """Freeze the values at the accepted state, undone by `begin_step`.

        Parameters
        ----------
        delay
            The one that has fully relaxed; all others have not relaxed at all.
        """


# Makes a term of the virtual work of given tissues; a `Term` itself is one.
MakeTerm = Callable[[Tissues], Term]


class Sum(Term):
    """Several terms as one."""

    def __init__(self, tissues: Tissues, terms: Iterable[Term]) -> None:
        super().__init__(tissues)
        self.terms = tuple(terms)
        self.is_symmetric = all(term.is_symmetric for term in self.terms)
        self.histories = [history for term in self.terms for history in term.histories]
        self.delays = [delay for term in self.terms for delay in term.delays]

    def at_skin(self) -> Sum:
        """Return the sum of those terms that pull at the skin."""
        return Sum(self.tissues, [term for term in self.terms if term.pulls_at_skin])

    def residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work in `v`."""
        return _sum_of_forms(term.residual(v) for term in self.terms)

    def work_of_tangent(self, v: Expr) -> ufl.Form:
        """Return the virtual work in `v` whose derivative is the tangent."""
        return _sum_of_forms(term.work_of_tangent(v) for term in self.terms)

    def static_residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work in `v` without that of inertia."""
        return _sum_of_forms(term.static_residual(v) for term in self.terms)

    def stress(self, tissue: str) -> Expr | None:
        """Return the first Piola stress in a tissue, MPa, (3, 3)."""
        return sum_of(term.stress(tissue) for term in self.terms)

    def energy(self, tissue: str) -> Expr | None:
        """Return the strain energy density that a tissue stores, MPa."""
        return sum_of(term.energy(tissue) for term in self.terms)

    def stored(self, w: Expr) -> ufl.Form:
        """Return the stored energy of all tissues, weighted with `w`."""
        return _sum_of_forms(term.stored(w) for term in self.terms)

    def skin_stiffness(self, tissue: str, gamma: Expr, height: Expr) -> Expr | None:
        """Return by how much the terms stiffen the contact, MPa/mm."""
        return sum_of(term.skin_stiffness(tissue, gamma, height) for term in self.terms)

    def begin_step(self) -> None:
        """Take the state's time step over."""
        for term in self.terms:
            term.begin_step()

    def freeze(self, delay: Delay | None) -> None:
        """Take the values at the accepted state."""
        for term in self.terms:
            term.freeze(delay)


def sum_of(values: Iterable[Expr | None]) -> Expr | None:
    """Return the sum of those expressions that there are; None without any."""
    present = [value for value in values if value is not None]
    return sum(present[1:], present[0]) if present else None


def _sum_of_forms(forms: Iterable[ufl.Form]) -> ufl.Form:
    return sum(forms, ufl.Form([]))


class StressTerm(Term):
    """A term that is given by its stress alone."""

    def residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work of the stress in `v`."""
        return self._work(v, self.tissues.dx)

    def work_of_tangent(self, v: Expr) -> ufl.Form:
        """Return the virtual work of the stress in `v`, integrated at fewer points."""
        return self._work(v, self.tissues.dx_of_tangent)

    def _work(self, v: Expr, dx: ufl.Measure) -> ufl.Form:
        gradient = self.tissues.gradient(v)
        form = ufl.Form([])
        for name, part in self.tissues.parts(dx).items():
            stress = self.stress(name)
            if stress is not None:
                form += ufl.inner(stress, gradient) * part
        return form
