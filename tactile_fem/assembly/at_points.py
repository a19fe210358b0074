"""Integrands at a point: fields, their gradients and the geometry there become plain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.core.expr import Expr
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction


def lowered(form: ufl.Form) -> ufl.Form:
    """Return a form without `div`, `curl` and the like, whose derivatives are gradients of fields.

    Integrals that vanish are left out.
    """
    return apply_derivatives(apply_algebra_lowering(form))


class NotAtPointsError(Exception):
    """An integrand contains what is not given at points, say, a second derivative."""


class OperandKind(IntEnum):
    """What is given at a point, numbered as in `virtual_work.c`."""

    VALUE = 0  # of a field
    GRADIENT = 1  # of a field
    AT_POINTS = 2  # value of a field that is known at the points of quadrature only
    NORMAL = 3
    DETERMINANT = 4
    FACET_DETERMINANT = 5


# What has dofs in cells.
IN_CELLS = OperandKind.VALUE, OperandKind.GRADIENT


@dataclass(frozen=True)
class Operand:
    """What is given at a point.

    Attributes
    ----------
    of
        A field, or the position; of the geometry None.
    """

    kind: OperandKind
    of: Expr | None = None

    def shape(self, dim: int) -> tuple[int, ...]:
        """Return the shape of its value in a space of that dimension."""
        if self.of is None:
            return (dim,) if self.kind == OperandKind.NORMAL else ()
        gradient = (dim,) if self.kind == OperandKind.GRADIENT else ()
        return (*self.of.ufl_shape, *gradient)


class AtPoint:
    """Integrands of a virtual work at a point.

    Parameters
    ----------
    u, v
        Unknown and test function.

    Attributes
    ----------
    operands
        All that the integrands need, in the order in which C functions take it.
    """

    def __init__(self, u: fem.Function, v: ufl.Argument) -> None:
        self._mesh: mesh.Mesh = u.function_space.mesh
        self.dim: int = self._mesh.geometry.dim
        self._u, self._v = u, v
        self._numbers: dict[Operand, Expr] = {}

    def __call__(self, integrand: Expr) -> Expr:
        """Return an integrand in which all that is given is a coefficient of its own.

        Raises
        ------
        NotAtPointsError
            It contains something else, such as derivatives that are no gradient of a field; see
            `lowered`.
        """
        replaced: Expr = map_expr_dag(_Replaced(self), integrand)
        return replaced

    @property
    def operands(self) -> list[Operand]:
        """All that the integrands need, but for the test function."""
        return [operand for operand in self._numbers if operand.of is not self._v]

    def sizes(self) -> list[int]:
        """Return how many numbers each of `operands` is."""
        return [int(np.prod(operand.shape(self.dim), dtype=int)) for operand in self.operands]

    def places(self, coefficient: ufl.Coefficient) -> range:
        """Return the places of a coefficient's numbers among all that are given.

        The test function's are not given: integrands are linear in it.
        """
        start = 0
        for operand, size in zip(self.operands, self.sizes(), strict=True):
            if self._numbers[operand].ufl_operands[0] == coefficient:
                return range(start, start + size)
            start += size
        return range(0)

    def number(self, operand: Operand) -> Expr:
        """Return what stands for an operand."""
        if operand not in self._numbers:
            cell = self._mesh.topology.cell_name()
            element = basix.ufl.element("DG", cell, 0, shape=operand.shape(self.dim))
            space = ufl.FunctionSpace(self._mesh.ufl_domain(), element)
            value = ufl.Coefficient(space, count=len(self._numbers))
            self._numbers[operand] = ufl.variable(value)
        return self._numbers[operand]

    # --- derivatives -----------------------------------------------------------------------------

    @property
    def tested(self) -> range:
        """What of the test function's value (0) and gradient (1 and more) the integrands have."""
        return self._used(self._v)

    @property
    def trial(self) -> range:
        """What of the unknown's value and gradient the integrands depend on, likewise."""
        return self._used(self._u)

    def work(self, integrand: Expr) -> Expr:
        """Return the factors of the test function, by component, (dimension times `tested`,)."""
        return _joined(self._derivatives(integrand, self._v), self.dim)

    def moduli(self, integrand: Expr, *, is_symmetric: bool) -> Expr:
        """Return the derivatives of `work` with respect to the unknown.

        Rows of ``dimension times tested`` times ``dimension times trial``, as one vector; if they
        are symmetric those of the upper triangle.
        """
        work = self.work(integrand)
        derivatives = self._derivatives(work, self._u)
        rows = [_joined([d[i, ...] for d in derivatives], self.dim) for i in range(len(work))]
        return ufl.as_vector(
            [row[j] for i, row in enumerate(rows) for j in range(i * is_symmetric, len(row))]
        )

    def _used(self, function: Expr) -> range:
        used = [Operand(kind, function) in self._numbers for kind in IN_CELLS]
        return range(1 - used[0], 1 + self.dim * used[1])

    def _derivatives(self, of: Expr, function: Expr) -> list[Expr]:
        """Return the derivatives with respect to a function's value and gradient, where used."""
        each = (Operand(kind, function) for kind in IN_CELLS)
        return [ufl.diff(of, self._numbers[own]) for own in each if own in self._numbers]


def _joined(derivatives: Sequence[Expr], dim: int) -> Expr:
    """Return derivatives by a value (dim,) and a gradient (dim, dim), by component of the value."""
    return ufl.as_vector(
        [
            entry
            for i in range(dim)
            for d in derivatives
            for entry in ([d[i]] if len(d.ufl_shape) == 1 else [d[i, j] for j in range(dim)])
        ]
    )


class _Replaced(MultiFunction):
    """Replaces what is given at points; whatever else depends on the place is refused."""

    expr = MultiFunction.reuse_if_untouched
    constant_value = constant = multi_index = label = MultiFunction.reuse_if_untouched

    def __init__(self, at: AtPoint) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._number = at.number

    def refused(self, value: Expr, *operands: Expr) -> Expr:
        raise NotAtPointsError

    terminal = derivative = restricted = cell_avg = facet_avg = reference_value = refused
    base_form_operator = refused

    def grad(self, gradient: Expr) -> Expr:
        (of,) = gradient.ufl_operands
        if not isinstance(of, fem.Function | ufl.Argument):
            raise NotAtPointsError
        return self._number(Operand(OperandKind.GRADIENT, of))

    def coefficient(self, function: fem.Function) -> Expr:
        is_known_there = function.ufl_element().is_quadrature
        kind = OperandKind.AT_POINTS if is_known_there else OperandKind.VALUE
        return self._number(Operand(kind, function))

    def argument(self, test: Expr) -> Expr:
        return self._number(Operand(OperandKind.VALUE, test))

    def spatial_coordinate(self, position: Expr) -> Expr:
        return self._number(Operand(OperandKind.VALUE, position))

    def facet_normal(self, normal: Expr) -> Expr:
        return self._number(Operand(OperandKind.NORMAL))

    def jacobian_determinant(self, determinant: Expr) -> Expr:
        return self._number(Operand(OperandKind.DETERMINANT))

    def facet_jacobian_determinant(self, determinant: Expr) -> Expr:
        return self._number(Operand(OperandKind.FACET_DETERMINANT))
