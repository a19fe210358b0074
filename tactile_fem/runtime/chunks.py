"""Long evaluations in parts, between which a signal is answered."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

_POINTS = 200_000  # a second or two


def in_chunks(
    evaluate: Callable[[NDArray], Sequence[NDArray]], points: NDArray
) -> tuple[NDArray, ...]:
    """Return the arrays (n, ...) that a function returns for points (n, d)."""
    starts = range(0, max(len(points), 1), _POINTS)
    parts = [evaluate(points[start : start + _POINTS]) for start in starts]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))
