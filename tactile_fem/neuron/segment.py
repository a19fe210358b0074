"""What transduction gives to the membrane: the current, stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from tactile_fem.neuron.exponentials import ExponentialSum

Array = NDArray[Any]


class Segment(NamedTuple):
    """A stretch of time with one expression for the current.

    Attributes
    ----------
    start_s, length_s
        Begin and length, s: numbers, or (n,) where the stretches differ.
    current_pA
        The current over the time since the begin, pA.
    who
        Which receptors; all have come to the begin.
    """

    start_s: Any
    length_s: Any
    current_pA: ExponentialSum
    who: Any = slice(None)


class Transduction(Protocol):
    """A model of transduction."""

    def segments(self, time_s: Array, drive: Array, /) -> Iterator[Segment]:
        """Yield the current that a history (t,), (t, receptors) evokes, in order.

        The history is linear between its samples; the current is exact.
        """
        ...
