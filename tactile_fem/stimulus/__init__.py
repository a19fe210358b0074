"""Rigid stimuli: letters, bars, gratings and other bodies by their signed distance."""

from tactile_fem.stimulus.body import Distance, Embossed, Outline, RigidBody, norm_of
from tactile_fem.stimulus.friction import (
    ConstantFriction,
    Friction,
    KineticFriction,
    MappedFriction,
    PressureFriction,
)
from tactile_fem.stimulus.spline import linear_between
from tactile_fem.stimulus.stimulus import Stimulus

# isort: off
# The kinds of stimulus, in the order in which the template and messages list them.
from tactile_fem.stimulus.text import Text
from tactile_fem.stimulus.smooth import Plate, Cylinder, Sphere, Edge
from tactile_fem.stimulus.patterns import Grating, Dots, Braille
from tactile_fem.stimulus.drawing import Drawing
from tactile_fem.stimulus.surface import Surface

# isort: on

__all__ = [
    "Braille",
    "ConstantFriction",
    "Cylinder",
    "Distance",
    "Dots",
    "Drawing",
    "Edge",
    "Embossed",
    "Friction",
    "Grating",
    "KineticFriction",
    "MappedFriction",
    "Outline",
    "Plate",
    "PressureFriction",
    "RigidBody",
    "Sphere",
    "Stimulus",
    "Surface",
    "Text",
    "linear_between",
    "norm_of",
]
