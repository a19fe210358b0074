"""Dirichlet conditions in a matrix of blocks: rows and columns of a diagonal one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem, la


class FrozenDofs:
    """Rows and columns of a matrix that have Dirichlet conditions.

    Parameters
    ----------
    matrix
        Its blocks have a row for each component of a node.
    bcs
        The conditions.

    Attributes
    ----------
    is_free
        Whether any component of a node may move, (nodes,), ghosts included.
    """

    def __init__(self, matrix: la.MatrixCSR, bcs: Sequence[fem.DirichletBC]) -> None:
        size = matrix.block_size[0]
        rows, columns = matrix.index_map(0), matrix.index_map(1)
        nodes = columns.size_local + columns.num_ghosts
        is_held = np.zeros((nodes, size), dtype=bool)
        for bc in bcs:
            is_held.ravel()[bc.dof_indices()[0]] = True
        self.is_free = ~is_held.all(axis=1)
        self._blocks = matrix.data.reshape(-1, size, size)
        row = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
        column = matrix.indices[: len(row)]
        # Blocks of wholly held nodes have no entries.
        partly = self.is_free & is_held.any(axis=1)
        blocks = np.flatnonzero(partly[row] | partly[column])
        held = is_held[row[blocks]][:, :, None] | is_held[column[blocks]][:, None, :]
        number, *entry = np.nonzero(held)
        self._zeros = blocks[number], *entry
        diagonal = np.flatnonzero((row == column) & (row < rows.size_local))
        number, component = np.nonzero(is_held[row[diagonal]])
        self._diagonal = diagonal[number], component, component

    def set_rows(self, diagonal: float) -> None:
        """Make the rows and columns zero but for the diagonal."""
        self._blocks[self._zeros] = 0.0
        self._blocks[self._diagonal] = diagonal
