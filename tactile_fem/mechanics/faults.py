"""Says in a sentence what compiler, cache and PETSc stumbled over."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

from cffi import VerificationError
from dolfinx import jit

from tactile_fem.errors import TactileError


@contextmanager
def preparing() -> Iterator[None]:
    """Explain what fails while forms are compiled.

    Raises
    ------
    TactileError
        A form cannot be compiled, or not be loaded from the cache.
    """
    try:
        yield
    except (OSError, ImportError, VerificationError) as error:
        _drop_half_made(error)
        raise TactileError(_of_compilation(error)) from error
    except RuntimeError as error:  # DOLFINx's word on several ranks
        if "JIT" not in str(error):
            raise
        _drop_half_made(error)
        raise TactileError(_of_compilation(error)) from error


def _drop_half_made(error: Exception) -> None:
    """Let go of half-made solvers, silently: DOLFINx's stumble when they are destroyed."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda unraisable: None
    traceback.clear_frames(error.__traceback__)
    sys.unraisablehook = hook


def last_line(error: PETSc.Error) -> str:
    """Return what PETSc says last, which is what is wrong."""
    return str(error).strip().splitlines()[-1].partition("] ")[2] or str(error)


def _of_compilation(error: Exception) -> str:
    if "CompileError" in str(error) or "LinkError" in str(error):
        return (
            "The C compiler failed, as it says above: look at solver.compiler_flags and at "
            "tactile-fem doctor."
        )
    folder = jit.get_options()["cache_dir"]
    return (
        f"The cache of compiled forms, {folder}, cannot be used ({error}): remove that folder, "
        "which is made again, or set XDG_CACHE_HOME to one that can be written."
    )
