"""The path of the body: pieces of motion in order."""

from tactile_fem.path.loads import NORMAL, HeldLoads
from tactile_fem.path.motion import Motion, Path, straight
from tactile_fem.path.rotations import matrix, vector

# isort: off
# The kinds of piece, in the order in which the template and messages list them.
from tactile_fem.path.pieces import Piece, Vibration, Press, Hold, Slide, Lift
from tactile_fem.path.push import Push
from tactile_fem.path.turns import Twist, Roll
from tactile_fem.path.follow import Follow

# isort: on
from tactile_fem.path.protocol import Protocol

__all__ = [
    "NORMAL",
    "Follow",
    "HeldLoads",
    "Hold",
    "Lift",
    "Motion",
    "Path",
    "Piece",
    "Press",
    "Protocol",
    "Push",
    "Roll",
    "Slide",
    "Twist",
    "Vibration",
    "matrix",
    "straight",
    "vector",
]
