"""Rigid stimuli: letters, bars, gratings and other bodies by their signed distance; their path."""

from tactile_fem.stimulus.body import Distance, RigidBody
from tactile_fem.stimulus.make import make_body, outlines
from tactile_fem.stimulus.make_path import make_path
from tactile_fem.stimulus.path import Motion, Path

__all__ = [
    "Distance",
    "Motion",
    "Path",
    "RigidBody",
    "make_body",
    "make_path",
    "outlines",
]
