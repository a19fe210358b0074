"""Finger mechanics and SA1 afferents: the response of a finger that strokes a surface."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("tactile-fem")
except PackageNotFoundError:
    __version__ = "unknown (not installed)"
