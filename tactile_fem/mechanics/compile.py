"""How the forms' C code is compiled: fast, and never run on a processor it was not made for."""

from __future__ import annotations

import fcntl
import hashlib
import logging
import platform
import struct
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from dolfinx import fem, jit
from ufl.core.expr import Expr

from tactile_fem.runtime.doctor import compiler

logger = logging.getLogger(__name__)

# How long to wait for another process that compiles the same form.
_WAIT_S = 300
# A source that has been unfinished for so long belongs to a process that was killed: no form takes
# so long to compile. The shorter time holds where no other process of this package uses the
# cache, so that only programs of others may be compiling.
_ABANDONED_S = 600
_ABANDONED_ALONE_S = 30

_locks: dict[Path, IO[str]] = {}  # open, and so locked, as long as this process lives


def jit_options(flags: Sequence[str]) -> dict[str, Any]:
    """Return DOLFINx's JIT options for the given C compiler flags; its own flags without any.

    ``-march=native`` is dropped where it is not understood (other than x86-64). Where it stays,
    the processor's features become part of the flags and so of the cache's key: a home folder
    shared by different processors then holds one version for each.

    From now on this process counts as a user of the cache.
    """
    _lock_shared(jit.get_options()["cache_dir"])
    chosen = [flag for flag in flags if flag != "-march=native" or _is_x86()]
    if "-march=native" in chosen:
        features = hashlib.sha256(_cpuinfo("flags").encode()).hexdigest()[:12]
        chosen.append(f"-DTACTILE_CPU={features}")
    own = {"cffi_extra_compile_args": chosen} if chosen else {}
    return {"timeout": _WAIT_S, **own}


def _is_x86() -> bool:
    return platform.machine() in ("x86_64", "AMD64")


def _cpuinfo(key: str) -> str:
    """Return what Linux knows of the processor; the machine's name where it knows nothing."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith(key))
    except (OSError, StopIteration):
        return platform.node()


def compiled_by() -> dict[str, str]:
    """Return the C compiler and the processor, on which the last digits of results depend."""
    return {"version": compiler_version(), "processor": _cpuinfo("model name")}


def compiler_version() -> str:
    """Return what the C compiler says of itself, or its command where it says nothing."""
    command = compiler() or ["cc"]
    try:
        said = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return command[0]
    return (said.stdout.splitlines() or command)[0]


def expression(value: Expr, points: np.ndarray) -> fem.Expression:
    """Compile a UFL expression for points of the reference cell or facet, (points, 3 or 2)."""
    return fem.Expression(value, points, jit_options={"timeout": _WAIT_S})


def clean_cache(folder: Path) -> None:
    """Remove from DOLFINx's cache what processes that were killed left unfinished.

    DOLFINx would wait for them and give up at every start, fail to write what is there, or crash
    on a library cut short.
    """
    patience_s = _ABANDONED_ALONE_S if _is_only_user(folder) else _ABANDONED_S
    for source in folder.glob("libffcx_*.c"):
        ready = source.with_suffix(".c.cached")
        with suppress(OSError):
            if not ready.exists():
                _remove_abandoned(source, patience_s)
            elif any(map(_is_cut_short, folder.glob(f"{source.stem}.*.so"))):
                ready.unlink()
                source.unlink()
    for ready in folder.glob("libffcx_*.c.cached"):
        with suppress(OSError):
            if not ready.with_suffix("").exists():
                ready.unlink()


def _remove_abandoned(source: Path, patience_s: float) -> None:
    """Remove an unfinished source once nobody can be compiling it, if that is soon."""
    left_s = source.stat().st_mtime + patience_s - time.time()
    if left_s > _ABANDONED_ALONE_S:
        logger.info("waiting for another process that compiles, %d s at most", _WAIT_S)
        return
    if left_s > 0:
        logger.info("waiting %.0f s for a process that may have been killed", left_s)
        time.sleep(left_s)
    if not source.with_suffix(".c.cached").exists():
        source.unlink()


def _is_only_user(folder: Path) -> bool:
    """Tell whether no other process of this package uses a cache; False where there are no locks.

    From now on this one does.
    """
    with suppress(OSError):
        stream = _lock_file(folder)
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            alone = True
        except BlockingIOError:
            alone = False
        fcntl.flock(stream, fcntl.LOCK_SH)
        return alone
    return False


def _lock_shared(folder: Path) -> None:
    """Use a cache. The system forgets the lock when the process ends, however it ends."""
    with suppress(OSError):  # DOLFINx will tell of a folder that cannot be written
        fcntl.flock(_lock_file(folder), fcntl.LOCK_SH)


def _lock_file(folder: Path) -> IO[str]:
    if folder not in _locks:
        folder.mkdir(parents=True, exist_ok=True)
        _locks[folder] = (folder / "tactile_fem.lock").open("a", encoding="ascii")
    return _locks[folder]


def _is_cut_short(library: Path) -> bool:
    """Tell whether an ELF file ends before its table of sections, which stands last."""
    with library.open("rb") as stream:
        header = stream.read(64)
    if len(header) < 64:
        return True
    (start,) = struct.unpack_from("<Q", header, 0x28)
    size, count = struct.unpack_from("<HH", header, 0x3A)
    return library.stat().st_size < int(start) + int(size) * int(count)
