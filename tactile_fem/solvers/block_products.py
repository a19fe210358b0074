"""Products with distributed matrices of dense blocks, of which symmetric ones are read half.

The products of PETSc and DOLFINx take three to ten times as long, see demos/pages/how/solver.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import la
from dolfinx.common import IndexMap

from tactile_fem.assembly.compile import c_functions

_SOURCE = Path(__file__).with_suffix(".c")
_PRODUCT = "int, const long long *, const int *, const REAL *, const double *, double *"
_DECLARATIONS = f"""
void begin(int, const double *, double *, double *);
void end(int, const double *, double *);
void copy(long long, const long long *, const double *, REAL *);
void add_product({_PRODUCT});
void add_symmetric_product({_PRODUCT});
"""


class BlockProduct:
    """Product with the sum of matrices; context of PETSc's Python type.

    Parameters
    ----------
    matrices
        Their values are copied by `take`. The columns of the first one contain those of the others.
    are_symmetric
        Whether each is; then its blocks beyond the diagonal are not read, and each row has a
        diagonal block.
    real
        C's type of the numbers that are stored: "double" or "float".
    jit_options
        Options of the compiler.
    """

    def __init__(
        self,
        matrices: Sequence[la.MatrixCSR],
        are_symmetric: Sequence[bool],
        real: str,
        jit_options: Mapping[str, Any],
    ) -> None:
        rows, size = matrices[0].index_map(1), matrices[0].block_size[0]
        lanes = 4 if size == 3 else size
        self._functions, ffi = c_functions(
            rows.comm,
            _SOURCE,
            _DECLARATIONS.replace("REAL", real),
            jit_options,
            SIZE=size,
            LANES=lanes,
            REAL=real,
        )
        self._pointer = ffi.from_buffer
        self._real, self._rows = real, rows.size_local
        self._x = np.zeros((rows.size_local + rows.num_ghosts, lanes))
        self._y = np.zeros((rows.size_local, lanes))
        self._ghosts = _ghost_update(rows) if rows.comm.size > 1 else None
        self._unit = number_type("double", lanes)
        self._parts = [
            _Part(matrix, rows, symmetric)
            for matrix, symmetric in zip(matrices, are_symmetric, strict=True)
        ]

    def take(self, part: int) -> None:
        """Copy the present values of a matrix; where they are zero only if it is symmetric."""
        for blocks in self._parts[part].updated():
            size = len(blocks.columns) * blocks.entries
            if len(blocks.values) < size + _SPARE:
                blocks.values = np.zeros(size + _SPARE, _NUMPY[self._real])
            self._functions.copy(
                len(blocks.columns),
                self._pointer("long long[]", blocks.chosen),
                self._pointer("double[]", self._parts[part].values),
                self._pointer(f"{self._real}[]", blocks.values),
            )

    def mult(self, operator: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set ``y`` to the product with ``x``; called by PETSc."""
        given, result = (self._pointer("double[]", array) for array in (self._x, self._y))
        self._functions.begin(self._rows, self._pointer("double[]", x.array_r), given, result)
        own, ghosts = self._x[: self._rows], self._x[self._rows :]
        if self._ghosts:
            self._ghosts.bcastBegin(self._unit, own, ghosts, MPI.REPLACE)
        for part in self._parts:  # while the ghosts are on their way
            self._add(self._functions.add_symmetric_product, part.lower, given, result)
        if self._ghosts:
            self._ghosts.bcastEnd(self._unit, own, ghosts, MPI.REPLACE)
        for part in self._parts:
            self._add(self._functions.add_product, part.whole, given, result)
        self._functions.end(self._rows, result, self._pointer("double[]", y.array_w))

    def _add(self, function: Any, blocks: _Blocks, given: Any, result: Any) -> None:
        if len(blocks.columns):
            function(
                self._rows,
                self._pointer("long long[]", blocks.starts),
                self._pointer("int[]", blocks.columns),
                self._pointer(f"{self._real}[]", blocks.values),
                given,
                result,
            )


_NUMPY = {"double": np.float64, "float": np.float32}
_SPARE = 3  # numbers that are read beyond the last block


class _Part:
    """One of the matrices, and which of its blocks are multiplied."""

    def __init__(self, matrix: la.MatrixCSR, columns: IndexMap, is_symmetric: bool) -> None:
        rows, entries = matrix.index_map(0).size_local, matrix.block_size[0] ** 2
        self._starts = matrix.indptr[: rows + 1]
        self._columns = columns_in(columns, matrix)
        self.values = matrix.data[: entries * self._starts[-1]]
        self._is_symmetric = is_symmetric
        self.lower, self.whole = _Blocks(entries), _Blocks(entries)
        if is_symmetric:
            row = np.repeat(np.arange(rows), np.diff(self._starts))
            self._choose(self.lower, self._columns <= row)
            # Another rank has the rows of ghosts, so what is multiplied by them is read whole.
            self._choose(self.whole, self._columns >= rows)

    def updated(self) -> tuple[_Blocks, _Blocks]:
        """Return the blocks to multiply with the present values."""
        if not self._is_symmetric:
            entries = self.whole.entries
            self._choose(self.whole, self.values.reshape(-1, entries).any(axis=1))
        return self.lower, self.whole

    def _choose(self, blocks: _Blocks, are_chosen: np.ndarray) -> None:
        blocks.chosen = np.flatnonzero(are_chosen)
        blocks.starts = np.searchsorted(blocks.chosen, self._starts).astype(np.int64)
        blocks.columns = self._columns[blocks.chosen].astype(np.int32)


class _Blocks:
    """Some blocks of this rank's rows of a matrix: which ones, ascending, and their values."""

    def __init__(self, entries: int) -> None:
        self.entries = entries
        self.chosen, self.starts = np.empty((2, 0), dtype=np.int64)
        self.columns = np.empty(0, dtype=np.int32)
        self.values = np.empty(0)


def columns_in(columns: IndexMap, matrix: la.MatrixCSR) -> np.ndarray:
    """Return the column of each block in this rank's rows, as another map numbers them."""
    own = matrix.index_map(1)
    found = matrix.indices[: matrix.indptr[matrix.index_map(0).size_local]]
    if own is columns:
        return found
    everywhere = own.local_to_global(np.arange(own.size_local + own.num_ghosts))
    return columns.global_to_local(everywhere)[found]


def _ghost_update(columns: IndexMap) -> PETSc.SF:
    """Return what sends blocks of a vector to the ranks that have them as ghosts."""
    firsts = np.array(columns.comm.allgather(columns.local_range[0]))
    owners = columns.owners
    places = np.column_stack([owners, columns.ghosts - firsts[owners]]).astype(np.int32)
    ghosts = PETSc.SF().create(columns.comm)
    ghosts.setGraph(columns.size_local, None, places)
    return ghosts


@cache
def number_type(real: str, count: int) -> MPI.Datatype:
    """Return MPI's type of so many numbers."""
    return {"double": MPI.DOUBLE, "float": MPI.FLOAT}[real].Create_contiguous(count).Commit()
