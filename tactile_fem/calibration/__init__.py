"""Fits tissues and finger to somebody's measurements: forces over depth, profiles of the skin.

`tactile_fem.fit` computes; what else is here needs no DOLFINx.
"""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.calibration.parameters import (
        Parameter,
        is_of_file,
        powers_of,
        value_at,
        with_values,
    )
    from tactile_fem.calibration.posterior import Posterior

__all__ = ["Parameter", "Posterior", "is_of_file", "powers_of", "value_at", "with_values"]

__getattr__ = lazily(
    __name__,
    {
        "parameters": ["Parameter", "is_of_file", "powers_of", "value_at", "with_values"],
        "posterior": ["Posterior"],
    },
)
