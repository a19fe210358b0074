"""The coarse operator of two-level multigrid, from the blocks of the fine matrix."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from dolfinx import la

from tactile_fem.assembly.compile import c_functions
from tactile_fem.solvers.block_products import columns_in

_SOURCE = Path(__file__).with_suffix(".c")
_STRUCTURE = "const int *, const int *"
_DECLARATION = (
    f"void add_coarse(int, {_STRUCTURE}, const double *, {_STRUCTURE}, const double *, "
    f"const long long *, const int *, const double *, {_STRUCTURE}, int *, double *);"
)


class CoarseOperator:
    """The product P^T A P of a sum of matrices with an interpolation from a coarser space.

    PETSc would need the sum in a format without blocks, whose product takes several times as long.

    Parameters
    ----------
    matrices
        The columns of the first one contain those of the others.
    interpolation
        Interpolation of each component alike.
    jit_options
        Options of the compiler.

    Attributes
    ----------
    matrix
        The coarse operator in AIJ format.
    """

    def __init__(
        self,
        matrices: Sequence[la.MatrixCSR],
        interpolation: PETSc.Mat,
        jit_options: Mapping[str, Any],
    ) -> None:
        columns, size = matrices[0].index_map(1), matrices[0].block_size[0]
        self._matrices = matrices
        self._columns = [columns_in(columns, matrix) for matrix in matrices]
        self._starts = [
            matrix.indptr[: columns.size_local + 1].astype(np.int64) for matrix in matrices
        ]
        self._functions, ffi = c_functions(
            columns.comm, _SOURCE, _DECLARATION, jit_options, SIZE=size
        )
        self._pointer = ffi.from_buffer
        nodes, self._parents = _parents(interpolation, matrices[0])
        self._children = self._parents[: columns.size_local].T.tocsr()
        ones = np.ones(len(self._columns[0]), np.float32)
        shape = (columns.size_local, self._parents.shape[0])
        fine = scipy.sparse.csr_array((ones, self._columns[0], self._starts[0]), shape=shape)
        pattern = (abs(self._children) @ fine @ abs(self._parents)).tocsr()
        self._structure = pattern.indptr.astype(np.int32), pattern.indices.astype(np.int32)
        self._place = np.zeros(len(nodes), np.int32)
        self._values = np.zeros((len(pattern.indices), size, size))
        self.matrix = PETSc.Mat().create(columns.comm)
        self.matrix.setSizes([interpolation.getSizes()[1]] * 2)
        self.matrix.setBlockSize(size)
        self.matrix.setType("aij")
        within = np.arange(size, dtype=np.int32)
        rows = np.repeat(nodes, np.diff(pattern.indptr))[:, None, None] * size + within[:, None]
        others = nodes[pattern.indices][:, None, None] * size + within
        self.matrix.setPreallocationCOO(
            *(np.broadcast_to(each, self._values.shape).ravel() for each in (rows, others))
        )

    def update(self) -> None:
        """Compute it from the present values of the matrices; all ranks call."""
        self._values[:] = 0.0
        integers = [self._pointer("int[]", array) for array in (*self._structure, self._place)]
        for matrix, starts, columns in zip(
            self._matrices, self._starts, self._columns, strict=True
        ):
            self._functions.add_coarse(
                len(self._place),
                *self._sparse(self._children),
                *self._sparse(self._parents),
                self._pointer("long long[]", starts),
                self._pointer("int[]", columns),
                self._pointer("double[]", matrix.data),
                *integers,
                self._pointer("double[]", self._values),
            )
        self.matrix.setValuesCOO(self._values.ravel(), PETSc.InsertMode.INSERT)

    def _sparse(self, matrix: scipy.sparse.csr_array) -> list[Any]:
        starts, nodes = (array.astype(np.int32) for array in (matrix.indptr, matrix.indices))
        return [
            self._pointer("int[]", starts),
            self._pointer("int[]", nodes),
            self._pointer("double[]", matrix.data),
        ]


def _parents(
    interpolation: PETSc.Mat, matrix: la.MatrixCSR
) -> tuple[np.ndarray, scipy.sparse.csr_array]:
    """Return the coarse nodes of this rank's columns, ghosts included, and their weights.

    Returns
    -------
    Global numbers of the nodes, (nodes,), and the weight of each in each column, (columns, nodes).
    """
    columns, size = matrix.index_map(1), matrix.block_size[0]
    starts, nodes, weights = interpolation.getValuesCSR()
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    used = (row % size == 0) & (weights != 0)
    row, nodes, weights = row[used] // size, nodes[used] // size, weights[used]
    order = np.arange(len(row)) - np.searchsorted(row, row)  # of a node among those of its row
    most = columns.comm.allreduce(int(order.max(initial=0)), op=max) + 1
    sent = la.vector(columns, 2 * most)
    table = sent.array.reshape(-1, most, 2)
    table[row, order] = np.column_stack([nodes, weights])
    sent.scatter_forward()
    column, order = np.nonzero(table[:, :, 1])
    numbers, local = np.unique(table[column, order, 0].astype(np.int32), return_inverse=True)
    shape = len(table), len(numbers)
    entries = table[column, order, 1], (column, local.astype(np.int32))
    return numbers, scipy.sparse.csr_array(entries, shape=shape)
