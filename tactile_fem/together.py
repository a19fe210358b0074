"""What one rank does for all: the result or the error reaches every rank."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI


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
    error = comm.bcast(error)
    if error is not None:
        raise error
    return comm.bcast(result) if share else result
