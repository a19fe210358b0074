"""Rigid stimuli: letters, bars, gratings and other bodies by their signed distance."""

from tactile_fem.stimulus.body import Distance, RigidBody
from tactile_fem.stimulus.make import make_body, outlines

__all__ = [
    "Distance",
    "RigidBody",
    "make_body",
    "outlines",
]
