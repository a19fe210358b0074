"""Estimates of constants that are fitted to measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Estimate:
    """A fitted constant with its 95 % interval.

    `doubt` says why the data do not determine it; empty if they do.
    """

    value: float
    low: float
    high: float
    doubt: str = ""


def r_squared(model: NDArray[Any], measured: NDArray[Any]) -> float:
    """Return the coefficient of determination; NaN if all measured values are equal."""
    spread = np.sum((measured - measured.mean()) ** 2)
    return float(1 - np.sum((model - measured) ** 2) / spread) if spread else float("nan")
