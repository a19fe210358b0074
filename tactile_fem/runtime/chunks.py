"""Long evaluations in parts, between which a signal is answered."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

# A second or two; libigl builds its trees anew for each part, at most a second of that.
_POINTS = 50_000


def in_chunks(
    evaluate: Callable[[NDArray], Sequence[NDArray]], points: NDArray
) -> tuple[NDArray, ...]:
    """Return the arrays (n, ...) that a function returns for points (n, d)."""
    starts = range(0, max(len(points), 1), _POINTS)
    parts = [evaluate(points[start : start + _POINTS]) for start in starts]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))
