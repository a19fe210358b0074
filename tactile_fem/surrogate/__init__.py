"""A finger in milliseconds, made from scans of the finite elements once."""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.surrogate.fast_finger import FastFinger, Loop
    from tactile_fem.surrogate.heights import HeightMap
    from tactile_fem.surrogate.rates import Rates
    from tactile_fem.surrogate.stepping import BodyState

__all__ = ["BodyState", "FastFinger", "HeightMap", "Loop", "Rates"]

__getattr__ = lazily(
    __name__,
    {
        "fast_finger": ["FastFinger", "Loop"],
        "heights": ["HeightMap"],
        "rates": ["Rates"],
        "stepping": ["BodyState"],
    },
    former={"Moment": "BodyState"},
)
