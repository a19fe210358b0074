"""The simulation of a study, and the scan; checks are imported without DOLFINx."""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.simulation.bone import Bone
    from tactile_fem.simulation.checkpoint import read_checkpoint
    from tactile_fem.simulation.checks import check
    from tactile_fem.simulation.load_search import TOLERANCE
    from tactile_fem.simulation.parts import NO_PARTS

__all__ = [
    "NO_PARTS",
    "TOLERANCE",
    "Bone",
    "check",
    "read_checkpoint",
]

__getattr__ = lazily(
    __name__,
    {
        "bone": ["Bone"],
        "checkpoint": ["read_checkpoint"],
        "checks": ["check"],
        "load_search": ["TOLERANCE"],
        "parts": ["NO_PARTS"],
    },
)
