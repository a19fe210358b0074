"""Work on one rank for all, and errors that reach all ranks."""

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

# How long a failed rank waits for the others to fail too, and then for its message to be read.
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
def shared_errors(comm: MPI.Comm) -> Iterator[None]:
    """Raise an error of any rank on all ranks, which must all enter; they must not communicate."""
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
    """Return an error that can be pickled: a built-in or own one as it is, others as text."""
    known = isinstance(error, TactileError) or type(error).__module__ == "builtins"
    return error if known else TactileError(f"{type(error).__name__}: {error}")


@contextmanager
def abort_if_one_fails(comm: MPI.Comm) -> Iterator[None]:
    """Raise an error if all ranks have one; end all ranks if only some of them do.

    Otherwise the other ranks would wait for ever. The ranks synchronize on a communicator of
    their own, so that communication in the block is not disturbed.
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
                os._exit(code)  # in some MPI libraries, Abort returns
        raise
    finally:
        own.Free()


def _all_arrive(comm: MPI.Comm) -> bool:
    """Return whether all ranks call this within a few seconds."""
    request = comm.Ibarrier()
    end = time.monotonic() + _PATIENCE_S
    while not request.Test():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def _await_reader(pipe: int) -> None:
    """Wait until the content of a pipe has been read, but only a few seconds.

    MPICH's mpiexec ends at once after an abort, and its proxy forwards the abort before the
    rank's stderr. On a busy machine the error message was lost.
    """
    if not stat.S_ISFIFO(os.fstat(pipe).st_mode):
        return
    end = time.monotonic() + _PATIENCE_S
    while int.from_bytes(fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)), sys.byteorder):
        if time.monotonic() > end:
            return
        time.sleep(0.01)
