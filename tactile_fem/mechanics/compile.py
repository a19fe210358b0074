"""How the forms' C code is compiled: fast, and never run on a processor it was not made for."""

from __future__ import annotations

import hashlib
import platform
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

# Another process that compiles the same form is waited for.
_WAIT_S = 120
# So long no form takes to compile: its process was killed.
_ABANDONED_S = 600


def jit_options(flags: Sequence[str]) -> dict[str, Any]:
    """Return DOLFINx's JIT options for the given C compiler flags.

    ``-march=native`` is dropped where it is not understood (other than x86-64). Where it stays,
    the processor's features become part of the flags and so of the cache's key: a home folder
    shared by different processors then holds one version for each.
    """
    chosen = [flag for flag in flags if flag != "-march=native" or _is_x86()]
    if not chosen:
        return {"timeout": _WAIT_S}
    if "-march=native" in chosen:
        chosen.append(f"-DTACTILE_CPU={_processor()}")
    return {"timeout": _WAIT_S, "cffi_extra_compile_args": chosen}


def forget_abandoned(folder: Path) -> None:
    """Remove from DOLFINx's cache what a killed process began to compile.

    DOLFINx would wait for it and then give up, at every start.
    """
    for source in folder.glob("libffcx_*.c"):
        ready = source.with_suffix(".c.cached")
        with suppress(OSError):
            if not ready.exists() and time.time() - source.stat().st_mtime > _ABANDONED_S:
                source.unlink()


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
