"""The scan: from a study to the histories and spikes of its receptors in a results folder.

Results and checks work without DOLFINx, so the functions that run a scan are imported on demand.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_fem.simulation.run import (
        Observation,
        Observer,
        Parts,
        ScanResult,
        completed,
        resume,
        scan,
    )

__all__ = ["Observation", "Observer", "Parts", "ScanResult", "completed", "resume", "scan"]


def __getattr__(name: str) -> Any:
    """Import a name from `tactile_fem.simulation.run`."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("tactile_fem.simulation.run"), name)
