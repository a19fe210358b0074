"""Turns errors of compiler, cache and PETSc into one sentence."""

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
def compilation_errors() -> Iterator[None]:
    """Turn errors in the compilation of forms into a TactileError.

    Raises
    ------
    TactileError
        A form cannot be compiled, or cannot be loaded from the cache.
    """
    try:
        yield
    except (OSError, ImportError, VerificationError) as error:
        _free_incomplete(error)
        raise TactileError(_of_compilation(error)) from error
    except RuntimeError as error:  # raised by DOLFINx on several ranks
        if "JIT" not in str(error):
            raise
        _free_incomplete(error)
        raise TactileError(_of_compilation(error)) from error


def _free_incomplete(error: Exception) -> None:
    """Free incomplete solvers silently: DOLFINx raises errors when they are destroyed."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda unraisable: None
    traceback.clear_frames(error.__traceback__)
    sys.unraisablehook = hook


def last_line(error: PETSc.Error) -> str:
    """Return the last line of PETSc's message, which states the problem."""
    return str(error).strip().splitlines()[-1].partition("] ")[2] or str(error)


def _of_compilation(error: Exception) -> str:
    if "CompileError" in str(error) or "LinkError" in str(error):
        return (
            "The C compiler failed, see its message above: check solver.compiler_flags and run "
            "tactile-fem doctor."
        )
    folder = jit.get_options()["cache_dir"]
    return (
        f"The cache of compiled forms, {folder}, cannot be used ({error}): remove that folder, "
        "which will be created again, or set XDG_CACHE_HOME to a writable one."
    )
