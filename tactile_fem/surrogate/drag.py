"""How far friction drags the skin of the pad along: as a block, on springs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_LEAST_MM = 1e-6


@dataclass(frozen=True)
class Drag:
    """The drag of sliding skin, ``mu c N^a`` along the slip; fitted to scans.

    Attributes
    ----------
    compliance_mm_per_N
        Its factor `c` along Y.
    exponent
        `a`, of the normal force.
    across
        Drag along X over that along Y.
    """

    compliance_mm_per_N: float
    exponent: float
    across: float

    def limit_mm(self, friction: Array, normal_N: Array) -> Array:
        """Return how far sliding skin is dragged along Y."""
        return friction * self.compliance_mm_per_N * np.maximum(normal_N, 0.0) ** self.exponent

    def slid(self, slip: Array, moved_mm: Array, limit_mm: Array) -> Array:
        """Return how the skin slips after the body has moved.

        Parameters
        ----------
        slip
            Direction of slip, (..., 2): its length is 0 where skin sticks unstrained and 1 where
            all of it slides.
        moved_mm
            By how much the body has moved, (..., 2).
        limit_mm
            (...,).
        """
        length = np.linalg.norm(moved_mm, axis=-1, keepdims=True)
        left = np.exp(-length / np.maximum(limit_mm[..., None], _LEAST_MM))
        return left * slip + (1 - left) * moved_mm / np.maximum(length, _LEAST_MM)

    def of(self, slip: Array, limit_mm: Array) -> Array:
        """Return the drag in mm, (..., 2)."""
        return limit_mm[..., None] * slip * np.array([self.across, 1.0])
