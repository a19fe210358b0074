"""Rows of the ranks' arrays, gathered on the first rank and distributed from it."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

Array = np.ndarray


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
