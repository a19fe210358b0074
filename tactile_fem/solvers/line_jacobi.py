"""The smoother of multigrid: block Jacobi over lines of nodes through the thin, stiff layers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import la

from tactile_fem.assembly.compile import c_functions
from tactile_fem.solvers.block_products import columns_in, number_type

_SOURCE = Path(__file__).with_suffix(".c")
_DECLARATION = "void multiply(int, int, const float *, const double *, double *);"
_WIDTH = 8  # numbers that processors multiply at once


class LineJacobi:
    """Block Jacobi over lines of nodes, a preconditioner for PETSc's Python type.

    One rank inverts a complete line even if the partition cuts it, so that the number of
    iterations does not depend on the number of ranks. Inverses are in single precision.

    Parameters
    ----------
    lines
        This rank's lines: global block indices, one array (lines, length) for each length.
    matrices
        Their sum is the matrix. The columns of the first one contain those of the others.
    like
        A vector with the layout of the matrix's rows.
    jit_options
        Options of the compiler.
    """

    def __init__(
        self,
        lines: list[np.ndarray],
        matrices: Sequence[la.MatrixCSR],
        like: PETSc.Vec,
        jit_options: Mapping[str, Any],
    ) -> None:
        blocks = np.concatenate([nodes.ravel() for nodes in lines]).astype(np.int32)
        size = matrices[0].block_size[0]
        rows = PETSc.IS().createBlock(size, blocks, comm=like.comm)
        self._values = PETSc.Vec().createSeq(size * len(blocks))
        self._result = self._values.duplicate()
        self._scatter = PETSc.Scatter().create(like, rows, self._values, None)
        self._shapes = [(len(nodes), size * nodes.shape[1]) for nodes in lines]
        self._spans = list(pairwise(np.cumsum([0, *(n * rows for n, rows in self._shapes)])))
        self._functions, ffi = c_functions(
            like.comm.tompi4py(), _SOURCE, _DECLARATION, jit_options, WIDTH=_WIDTH
        )
        self._pointer = ffi.from_buffer
        self._inverses: list[np.ndarray] = []
        self._matrices = matrices
        self._chosen, self._sums = self._locate(lines, like.duplicate())
        self._unit = number_type("double", size**2)

    def _locate(
        self, lines: list[np.ndarray], like: PETSc.Vec
    ) -> tuple[list[np.ndarray], PETSc.SF]:
        """Return which blocks of the matrices couple nodes of a line, and what sums them there."""
        columns, size = self._matrices[0].index_map(1), self._matrices[0].block_size[0]
        count, known = sum(nodes.size * nodes.shape[1] for nodes in lines), la.vector(columns, 3)
        firsts = np.cumsum([0, *columns.comm.allgather(count)])
        first, parts = firsts[columns.comm.rank], []
        for nodes in lines:  # of each node: first block of its line, length, row
            length = nodes.shape[1]
            starts = first + length**2 * np.arange(len(nodes))
            each = np.broadcast_arrays(starts[:, None], length, np.arange(length))
            parts.append(np.reshape(each, (3, -1)))
            first += nodes.size * length
        for k, values in enumerate(np.concatenate(parts, axis=1)):
            self._values.array = np.repeat(values, size)
            self._scatter.scatter(self._values, like, mode=PETSc.ScatterMode.REVERSE)
            known.array.reshape(-1, 3)[: columns.size_local, k] = like.array_r[::size]
        known.scatter_forward()
        start, length, place = known.array.reshape(-1, 3).astype(np.int64).T
        chosen, places = [], []
        for matrix in self._matrices:
            column = columns_in(columns, matrix)
            row = np.repeat(
                np.arange(columns.size_local), np.diff(matrix.indptr[: columns.size_local + 1])
            )
            found = np.flatnonzero(start[row] == start[column])
            row, column = row[found], column[found]
            chosen.append(found)
            places.append(start[row] + length[row] * place[row] + place[column])
        there = np.concatenate(places)
        rank = np.searchsorted(firsts, there, side="right") - 1
        sums = PETSc.SF().create(columns.comm)
        sums.setGraph(count, None, np.column_stack([rank, there - firsts[rank]]).astype(np.int32))
        return chosen, sums

    def invert(self) -> None:
        """Invert the blocks of the matrices' present values; all ranks call."""
        size = self._matrices[0].block_size[0]
        values = np.concatenate(
            [
                matrix.data.reshape(-1, size**2)[chosen]
                for matrix, chosen in zip(self._matrices, self._chosen, strict=True)
            ]
        )
        dense = np.zeros((sum(n * (rows // size) ** 2 for n, rows in self._shapes), size**2))
        self._sums.reduceBegin(self._unit, values, dense, MPI.SUM)
        self._sums.reduceEnd(self._unit, values, dense, MPI.SUM)
        self._inverses = []
        for lines, rows in self._shapes:
            length = rows // size
            blocks, dense = np.split(dense, [lines * length**2])
            blocks = blocks.reshape(lines, length, length, size, size).swapaxes(2, 3)
            self._inverses.append(_in_strips(np.linalg.inv(blocks.reshape(lines, rows, rows))))

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set ``y`` to the block-diagonal inverse times ``x``; called by PETSc."""
        self._scatter.scatter(x, self._values)
        given, result = self._values.array_r, self._result.array_w
        for (first, end), shape, inverse in zip(
            self._spans, self._shapes, self._inverses, strict=True
        ):
            self._functions.multiply(
                *shape,
                self._pointer("float[]", inverse),
                self._pointer("double[]", given[first:end]),
                self._pointer("double[]", result[first:end]),
            )
        self._scatter.scatter(self._result, y, mode=PETSc.ScatterMode.REVERSE)


def _in_strips(matrices: np.ndarray) -> np.ndarray:
    """Return matrices (lines, length, length) as the C function reads them."""
    lines, length, _ = matrices.shape
    count = -(-length // _WIDTH)
    strips = np.zeros((lines, count * _WIDTH, length), np.float32)
    strips[:, :length] = matrices
    return np.ascontiguousarray(strips.reshape(lines, count, _WIDTH, length).swapaxes(2, 3))
