"""Loads that a piece of the path holds by moving the body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Components of a load: forces on the finger, N, and torque about Z through the body's origin, Nmm.
COMPONENTS = ("X", "Y", "Z", "torque")
NORMAL = 2


@dataclass(frozen=True)
class HeldLoads:
    """Which components of the load on the finger are held, and at what.

    The body moves along X, Y and Z, and turns about Z, as each of them needs; along the others it
    follows the path.

    Parameters
    ----------
    components
        Indices of `COMPONENTS`, in increasing order.
    at
        Takes the time in s since the piece began, and the load when it began, (4,) in N and Nmm;
        returns the load (4,), of which the held components count.
    """

    components: tuple[int, ...]
    at: Callable[[float, Array], Array]

    @classmethod
    def normal(cls, force_N: float) -> HeldLoads:
        """Return a constant normal force."""
        return cls((NORMAL,), lambda _, start: np.array([0.0, 0.0, force_N, 0.0]))


# Along all directions the body follows its path.
NOTHING = HeldLoads((), lambda _, start: start)
