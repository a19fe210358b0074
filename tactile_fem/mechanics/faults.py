"""Turns errors of compiler, cache and PETSc into one sentence, and signals into StoppedError."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

from cffi import VerificationError
from dolfinx import jit

from tactile_fem.errors import StoppedError, TactileError
from tactile_fem.runtime.ranks import StopRequest, signal_handler


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
    except StoppedError as error:
        _free_incomplete(error)
        raise
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


@contextmanager
def stopping(snes: PETSc.SNES, comm: MPI.Comm) -> Iterator[StopRequest]:
    """Stop at signals between Newton iterations and where it is checked; explain PETSc's errors."""
    stop = StopRequest(comm)
    snes.setMonitor(stop.check)
    try:
        with signal_handler(stop.request):
            yield stop
    except PETSc.Error as error:
        if error.__cause__:  # a monitor's or an assembly's own
            raise error.__cause__ from None
        raise TactileError(f"PETSc failed ({last_line(error)})") from error
    finally:
        snes.cancelMonitor()


def last_line(error: PETSc.Error) -> str:
    """Return the last line of PETSc's message, which states the problem."""
    return str(error).strip().splitlines()[-1].partition("] ")[2] or str(error)


def _of_compilation(error: Exception) -> str:
    if "CompileError" in str(error) or "LinkError" in str(error):
        reason = re.sub(r"[Cc]ommand '.*' (?=returned|failed)", "its command ", str(error))
        return (
            f"The C compiler failed ({reason.strip('. ')}); what it said is above. Check "
            "solver.compiler_flags and the variables CC, CFLAGS and LDFLAGS, and run tactile-fem "
            "doctor."
        )
    folder = jit.get_options()["cache_dir"]
    return (
        f"The cache of compiled forms, {folder}, cannot be used ({error}): remove that folder, "
        "which will be created again, or set XDG_CACHE_HOME to a writable one."
    )
