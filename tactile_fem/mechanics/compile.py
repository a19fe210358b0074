"""How the forms' C code is compiled: fast, and never run on a processor it was not made for."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from pathlib import Path


def jit_options(flags: Sequence[str]) -> dict[str, list[str]]:
    """Return DOLFINx's JIT options for the given C compiler flags.

    ``-march=native`` is dropped where it is not understood (other than x86-64). Where it stays,
    the processor's features become part of the flags and so of the cache's key: a home folder
    shared by different processors then holds one version for each.
    """
    chosen = [flag for flag in flags if flag != "-march=native" or _is_x86()]
    if not chosen:
        return {}
    if "-march=native" in chosen:
        chosen.append(f"-DTACTILE_CPU={_processor()}")
    return {"cffi_extra_compile_args": chosen}


def _is_x86() -> bool:
    return platform.machine() in ("x86_64", "AMD64")


def _processor() -> str:
    """Return a short digest of the processor's instruction sets."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
        features = next(line for line in lines if line.startswith("flags"))
    except (OSError, StopIteration):
        features = platform.node()
    return hashlib.sha256(features.encode()).hexdigest()[:12]
