"""Rigid stimuli: letters, bars, gratings and other bodies by their signed distance."""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily
from tactile_fem.stimulus.body import NEAR_MM, Distance, Embossed, Outline, RigidBody, norm_of
from tactile_fem.stimulus.friction import (
    ConstantFriction,
    Friction,
    KineticFriction,
    MappedFriction,
    PressureFriction,
)
from tactile_fem.stimulus.heights import (
    HEIGHT_READERS,
    LEAST_HEIGHTS,
    RawHeights,
    check_gray,
    check_single,
)
from tactile_fem.stimulus.stimulus import Stimulus

# isort: off
# The kinds of stimulus, in the order in which the template and messages list them.
from tactile_fem.stimulus.text import Text
from tactile_fem.stimulus.smooth import Plate, Cylinder, Sphere, Edge
from tactile_fem.stimulus.patterns import Grating, Dots, Braille
from tactile_fem.stimulus.drawing import Drawing
from tactile_fem.stimulus.surface import Surface
from tactile_fem.stimulus.function import Heights

# isort: on

if TYPE_CHECKING:
    from tactile_fem.stimulus.spline import GridSpline, linear_between

__all__ = [
    "HEIGHT_READERS",
    "LEAST_HEIGHTS",
    "NEAR_MM",
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
    "GridSpline",
    "Heights",
    "KineticFriction",
    "MappedFriction",
    "Outline",
    "Plate",
    "PressureFriction",
    "RawHeights",
    "RigidBody",
    "Sphere",
    "Stimulus",
    "Surface",
    "Text",
    "check_gray",
    "check_single",
    "linear_between",
    "norm_of",
]

__getattr__ = lazily(__name__, {"spline": ["GridSpline", "linear_between"]})  # SciPy takes a while
