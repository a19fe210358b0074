"""Rows of the ranks' arrays, gathered on the first rank and distributed from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpi4py import MPI

import numpy as np

Array = np.ndarray
# An array that is the same on all ranks, or a function that gathers those that the ranks hold.
Snapshot = Mapping[str, Array | Callable[[], Array]]


def gathered(saved: Snapshot) -> dict[str, Array]:
    """Return all arrays, those of nodes and points on the first rank: others have no rows of them.

    All ranks call.
    """
    return {name: value() if callable(value) else value for name, value in saved.items()}


def gather_rows(comm: MPI.Comm, own: Array) -> Array:
    """Return the rows (n, columns) of all ranks, in their order, on the first one; none on others.

    All ranks call, with the same type and number of columns.
    """
    own, counts = np.ascontiguousarray(own), comm.gather(own.size)
    if counts is None:
        comm.Gatherv(own, None)
        return own[:0]
    together = np.empty((sum(counts) // own.shape[1], own.shape[1]), own.dtype)
    comm.Gatherv(own, (together, counts))
    return together


def scatter_rows(comm: MPI.Comm, together: Array, own: Array) -> None:
    """Set the rows `own` (n, columns), contiguous, to those that `gather_rows` made of them.

    All ranks call; those of all ranks `together` are needed on the first one only.
    """
    counts = comm.gather(own.size)
    comm.Scatterv(None if counts is None else (np.ascontiguousarray(together), counts), own)
