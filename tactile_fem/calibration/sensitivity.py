"""How displacement and forces change with the constants of the tissues, from the tangent at hand.

A step solves ``R(u; u_old, d_old, m) = 0``, with `d_old` the histories at quadrature points and `m`
the constants. Differentiated along a change of the constants, with `K` the Jacobian of the
converged state,

    K du = -[R]',    dd = [d]',    df = [f]',

where ``[.]'`` is the derivative along the constants and everything that depends on them so far:
for the residual the old displacement and the old histories, for the new histories `d` and a result
`f`, such as a force, the new displacement besides. It is taken as a central difference of the
compiled forms, so any law and any history is included. A step costs one Jacobian and, for each
change, one linear solve, where a scan with changed constants costs all of its Newton iterations.
(Direct differentiation; Michaleris, Tortorelli and Vidal 1994, Int. J. Numer. Meth. Eng.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from tactile_fem.solvers import FingerProblem

Array = np.ndarray
# A change of the constants' logarithms: small against where contact begins (displacements move by
# nanometres), large against rounding.
_CHANGE = 1e-5

# Tissue and name of each constant that changes, and its power: the constant times exp(power x).
Change = Mapping[tuple[str, str], float]


@dataclass
class _Derivatives:
    """Along one change: of displacement and histories, in turn."""

    now: list[Array]
    old: list[Array]  # at the last accepted step


class Sensitivities:
    """Derivatives along changes of the constants, carried from step to step.

    `follow` is to be called after each accepted step, from the first on. The problem has no own
    laws in the place of the constants that change.
    """

    def __init__(self, problem: FingerProblem, changes: Sequence[Change]) -> None:
        self._problem, self._state = problem, problem.state
        self._changes = changes
        self._along = [_Derivatives(self._zeros(), self._zeros()) for _ in changes]

    def derivative(self, of: Callable[[], Array]) -> Array:
        """Return the derivatives (changes, k) of the numbers (k,) that `of` returns.

        It evaluates them at the end of the last accepted step; all ranks call.
        """
        with self._problem.reopened():
            found = [
                self._difference(change, along, of)
                for change, along in zip(self._changes, self._along, strict=True)
            ]
        return np.array(found)

    def _zeros(self) -> list[Array]:
        fields = self._state.u, *(history.old for history in self._state.histories)
        return [np.zeros_like(field.x.array) for field in fields]

    def follow(self) -> None:
        """Differentiate the last accepted step."""
        if not self._changes:
            return
        with self._problem.reopened(), self._problem.solver.linearized() as solve:
            for change, along in zip(self._changes, self._along, strict=True):
                along.old, along.now = along.now, self._zeros()  # at a held displacement
                residual = self._difference(change, along, self._problem.solver.residual)
                along.now[0] = solve(-residual)
                along.now[1:] = [
                    self._difference(change, along, history.present)
                    for history in self._state.histories
                ]

    def _difference(self, change: Change, along: _Derivatives, of: Callable[[], Array]) -> Array:
        """Return the derivative of what `of` returns along a change."""
        values = []
        for amount in (_CHANGE, -_CHANGE):
            with self._moved(change, along, amount):
                values.append(np.array(of()))
        return (values[0] - values[1]) / (2 * _CHANGE)

    @contextmanager
    def _moved(self, change: Change, along: _Derivatives, amount: float) -> Iterator[None]:
        """Change the constants and, in proportion, what depends on them, within the context."""
        state = self._state
        arrays = [state.u.x.array, state.u_old.x.array]
        arrays += [history.old.x.array for history in state.histories]
        saved = [array.copy() for array in arrays]
        values = self._problem.tissues.materials
        constants = [getattr(values[tissue], name) for tissue, name in change]
        numbers = [float(constant.value) for constant in constants]
        for array, by in zip(arrays, (along.now[0], *along.old), strict=True):
            array += amount * by
        for constant, power in zip(constants, change.values(), strict=True):
            constant.value *= np.exp(amount * power)
        self._problem.terms.begin_step()
        try:
            yield
        finally:
            for array, before in zip(arrays, saved, strict=True):
                array[:] = before
            self._problem.terms.begin_step()
            for constant, number in zip(constants, numbers, strict=True):
                constant.value = number
