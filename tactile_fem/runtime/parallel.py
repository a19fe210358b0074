"""What one rank does for all, and an end for all: the result or the error reaches every rank."""

from __future__ import annotations

import fcntl
import logging
import os
import stat
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI

from tactile_fem.errors import TactileError

logger = logging.getLogger(__name__)

# How long a rank that failed waits for the others to fail as well, and then to be heard.
_PATIENCE_S = 5.0


def on_root[T](comm: MPI.Comm, action: Callable[[], T], *, share: bool = True) -> T:
    """Run `action` on rank 0 and return its result on all ranks.

    Parameters
    ----------
    comm
        Communicator; all its ranks must call.
    action
        Called on rank 0 only. If it raises, all ranks raise the same error.
    share
        Whether the other ranks get the result; they get None otherwise.
    """
    result: Any = None
    error: Exception | None = None
    if comm.rank == 0:
        try:
            result = action()
        except Exception as caught:
            error = caught
    sent = comm.bcast(_sendable(error))
    if sent is not None:
        raise error or sent
    return comm.bcast(result) if share else result


@contextmanager
def raising_together(comm: MPI.Comm) -> Iterator[None]:
    """Raise on all ranks what any of them raises in the block, which must not communicate.

    Parameters
    ----------
    comm
        Communicator; all its ranks must enter.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as caught:
        error = caught
    if not comm.allreduce(error is not None, op=MPI.LOR):
        return
    errors = comm.allgather(_sendable(error))
    raise error or next(found for found in errors if found is not None)


def _sendable(error: Exception | None) -> Exception | None:
    """Return an error that other ranks can make again: Python's or the package's own, or words."""
    known = isinstance(error, TactileError) or type(error).__module__ == "builtins"
    return error if known else TactileError(f"{type(error).__name__}: {error}")


@contextmanager
def ending_together(comm: MPI.Comm) -> Iterator[None]:
    """Let an error out of the block only if all ranks have one; otherwise end all ranks.

    An error on some ranks would leave the others waiting for ever. What they wait for is left
    alone: the ranks meet on a communicator of their own.
    """
    if comm.size == 1:
        yield
        return
    own = comm.Dup()
    try:
        yield
    except BaseException as error:
        if not _all_arrive(own):
            trace = None if isinstance(error, TactileError | OSError) else error
            code = getattr(error, "exit_code", 1)
            try:
                logger.critical("rank %d ends all: %s", comm.rank, error, exc_info=trace)
                _await_reader(2)
            finally:
                comm.Abort(code)
                os._exit(code)  # some MPI return from their abort
        raise
    finally:
        own.Free()


def _all_arrive(comm: MPI.Comm) -> bool:
    """Tell whether all ranks call this within a few seconds."""
    request = comm.Ibarrier()
    end = time.monotonic() + _PATIENCE_S
    while not request.Test():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def _await_reader(pipe: int) -> None:
    """Wait until what was written into a pipe has been read, a few seconds at most.

    MPICH's mpiexec ends as soon as it hears of an abort, and its proxy passes that on before what
    the rank said on stderr: on a busy machine the sentence was lost.
    """
    if not stat.S_ISFIFO(os.fstat(pipe).st_mode):
        return
    end = time.monotonic() + _PATIENCE_S
    while int.from_bytes(fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)), sys.byteorder):
        if time.monotonic() > end:
            return
        time.sleep(0.01)
