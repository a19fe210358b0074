"""Laws of the tissues, in UFL, and what follows from their energies.

A law states only its energy `W(F, at)` in MPa (mJ/mm3), where `at` tells the place: constants may
vary in space and directions of fibres be given as a field of the finger. Stress, tangent and moduli
are UFL's derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.expand_indices import IndexExpander
from ufl.core.expr import Expr
from ufl.core.multiindex import MultiIndex

from tactile_fem.errors import StudyError


class Fields(dict[str, Any]):
    """Fields of the finger by name, in UFL; those that it lacks are named in a `StudyError`."""

    def __missing__(self, name: str) -> Any:
        raise StudyError(
            f'a law of the tissues needs the field "{name}"; the finger has '
            f"{', '.join(self) or 'no fields'}: give a mesh that has it (finger.mesh_file)."
        )


@dataclass(frozen=True)
class At:
    """The place at which a law is evaluated.

    Attributes
    ----------
    X
        Undeformed position in the finger's axes, mm, (3,).
    fields
        `FingerMesh.fields` there, such as directions of fibres.
    """

    X: Expr
    fields: Fields


ORIGIN = At(ufl.as_vector([0.0, 0.0, 0.0]), Fields())


class Law(Protocol):
    """A hyperelastic law, defined by its energy."""

    def energy(self, F: Expr, at: At) -> Expr:
        """Return the strain energy density, in MPa.

        Parameters
        ----------
        F
            Deformation gradient, (3, 3).
        at
            The place: position and fields.
        """


@dataclass(frozen=True)
class VolumeChange:
    """The part of a law's energy that a change of volume alone would store."""

    law: Law

    def energy(self, F: Expr, at: At) -> Expr:
        """Return ``W(J^(1/3) I)``, in MPa."""
        return self.law.energy(ufl.det(F) ** (1 / 3) * ufl.Identity(3), at)


def invariants(F: Expr) -> tuple[Expr, Expr, Expr]:
    """Return ``J``, ``I1bar - 3`` and ``I2bar - 3`` with ``Cbar = J^(-2/3) C``."""
    J, C = ufl.det(F), F.T * F
    I1 = ufl.tr(C)
    I2 = (I1**2 - ufl.tr(C * C)) / 2
    return J, J ** (-2 / 3) * I1 - 3, J ** (-4 / 3) * I2 - 3


def stress(law: Law, F: Expr, at: At) -> Expr:
    """Return the first Piola stress ``dW/dF`` of `law` at a place, in MPa."""
    variable = ufl.variable(F)
    return ufl.diff(law.energy(variable, at), variable)


def stiffness(law: Law, F: Expr, at: At) -> Expr:
    """Return the stiffness ``K + 4 G/3`` of `law` at `F` and a place, in MPa.

    `K` is the slope of the pressure in a pure volume change to the volume of `F`, `G` that of
    `shear_stiffness`.
    """
    J = ufl.variable(ufl.det(F))
    K = ufl.diff(ufl.diff(law.energy(J ** (1 / 3) * ufl.Identity(3), at), J), J)
    return K + 4 * shear_stiffness(law, F, at) / 3


def shear_stiffness(law: Law, F: Expr, at: At) -> Expr:
    """Return the slope of the shear stress at the distortion of `F`, ``gamma^2 = I1bar - 3``."""
    distortion = invariants(F)[1]
    gamma = ufl.variable(ufl.sqrt(ufl.max_value(distortion, 0.0)))
    across = ufl.as_matrix([[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    return ufl.diff(ufl.diff(law.energy(ufl.Identity(3) + gamma * across, at), gamma), gamma)


def shear_modulus(law: Law, at: At = ORIGIN) -> Expr:
    """Return the small-strain shear modulus, in MPa: ``d2W/dgamma2`` in simple shear at rest.

    It contains no more than the law's constants and what it takes from the place.
    """
    return _curvature(lambda x: law.energy(ufl.as_matrix([[1, x, 0], [0, 1, 0], [0, 0, 1]]), at), 0)


def bulk_modulus(law: Law, at: At = ORIGIN) -> Expr:
    """Return the small-strain bulk modulus, in MPa: ``d2W/dJ2`` at rest; see `shear_modulus`."""

    def energy(J: Expr) -> Expr:
        s = J ** (1 / 3)
        return law.energy(ufl.as_matrix([[s, 0, 0], [0, s, 0], [0, 0, s]]), at)

    return _curvature(energy, 1)


def _curvature(energy: Callable[[Expr], Expr], rest: float) -> Expr:
    """Return the second derivative of an energy by a measure of strain that is a number at rest."""
    x = ufl.variable(ufl.as_ufl(float(rest)))
    second = ufl.diff(ufl.diff(energy(x), x), x)
    return _Expander().visit(apply_derivatives(apply_algebra_lowering(second)))


class _Expander(IndexExpander):
    """UFL's, which visits each part of an expression once, and strips variables."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._found: dict[tuple[int, tuple[int, ...]], Any] = {}  # by `id`: parts stay alive

    def variable(self, o: Any) -> Any:
        return self.visit(o.ufl_operands[0])

    def visit(self, o: Any) -> Any:
        key = id(o), self.component()  # type: ignore[no-untyped-call]
        if isinstance(o, MultiIndex) or o.ufl_free_indices or key not in self._found:
            self._found[key] = super().visit(o)  # type: ignore[no-untyped-call]
        return self._found[key]
