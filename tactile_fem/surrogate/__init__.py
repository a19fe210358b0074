"""A finger in milliseconds, made from scans of the finite elements once."""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.surrogate.course import Moment
    from tactile_fem.surrogate.fast_finger import FastFinger, Loop
    from tactile_fem.surrogate.heights import HeightMap

__all__ = ["FastFinger", "HeightMap", "Loop", "Moment"]

__getattr__ = lazily(
    __name__,
    {"course": ["Moment"], "fast_finger": ["FastFinger", "Loop"], "heights": ["HeightMap"]},
)
