"""The scan: from a study to what every receptor felt and fired, kept in a folder.

Results and checks are read without DOLFINx, so what runs a scan is imported when it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_fem.scan.run import (
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
    """Return what runs a scan."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("tactile_fem.scan.run"), name)
