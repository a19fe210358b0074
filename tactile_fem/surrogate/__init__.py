"""A finger in milliseconds, made from scans of the finite elements once."""

from tactile_fem.surrogate.course import Moment
from tactile_fem.surrogate.fast_finger import FastFinger, Loop
from tactile_fem.surrogate.heights import HeightMap

__all__ = ["FastFinger", "HeightMap", "Loop", "Moment"]
