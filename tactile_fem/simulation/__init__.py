"""The simulation of a study, and the scan: its histories and spikes in a results folder.

Results and checks work without DOLFINx, so what steps the mechanics is imported on demand.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_fem.simulation.parts import Parts
    from tactile_fem.simulation.run import ScanResult, completed, resume, scan
    from tactile_fem.simulation.simulation import Observation, Observer, Simulation

__all__ = [
    "Observation",
    "Observer",
    "Parts",
    "ScanResult",
    "Simulation",
    "completed",
    "resume",
    "scan",
]
_SIMULATION = {"Observation", "Observer", "Simulation"}


def __getattr__(name: str) -> Any:
    """Import a name from its module."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = "simulation" if name in _SIMULATION else "parts" if name == "Parts" else "run"
    return getattr(import_module(f"{__name__}.{module}"), name)
