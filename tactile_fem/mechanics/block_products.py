"""Products with distributed matrices of dense blocks, of which symmetric ones are read half.

The products of PETSc and DOLFINx take three to ten times as long where no cache holds the matrix,
see demos/benchmarks.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import la

from tactile_fem.mechanics.compile import c_functions

_SOURCE = Path(__file__).with_suffix(".c")
_ARGUMENTS = "int, const long long *, const int *, const double *, const double *, double *"
_DECLARATIONS = "".join(
    f"void {name}({_ARGUMENTS});" for name in ("add_product", "add_symmetric_product")
)


class BlockProduct:
    """Product with a matrix.

    Parameters
    ----------
    matrix
        Its values are copied by `take`.
    jit_options
        Of the compiler.
    is_symmetric
        Whether it is; then its blocks beyond the diagonal are not read, and each row has a
        diagonal block.
    """

    def __init__(
        self, matrix: la.MatrixCSR, jit_options: Mapping[str, Any], *, is_symmetric: bool = False
    ) -> None:
        size = matrix.block_size[0]
        self._functions, self._pointer = c_functions(
            matrix.index_map(0).comm, _SOURCE, _DECLARATIONS, jit_options, SIZE=size
        )
        self._x = la.vector(matrix.index_map(1), size)
        rows = matrix.index_map(0).size_local
        row = np.repeat(np.arange(rows), np.diff(matrix.indptr[: rows + 1]))
        column = matrix.indices[: len(row)]
        if is_symmetric:
            # Another rank has the rows of ghosts, so what is multiplied by them is read whole.
            self._lower = _Blocks(matrix, np.flatnonzero(column <= row))
            self._others = _Blocks(matrix, np.flatnonzero(column >= rows))
        else:
            self._lower = _Blocks(matrix, np.empty(0, dtype=np.int64))
            self._others = _Blocks(matrix, np.arange(len(row)))
        self._is_symmetric = is_symmetric

    def take(self) -> None:
        """Copy the matrix's present values."""
        self._lower.take()
        self._others.take()

    def add(self, x: np.ndarray, y: np.ndarray) -> None:
        """Add the product with `x` to `y`, both of this rank's rows; all ranks call."""
        with_ghosts = self._x.array
        with_ghosts[: len(x)] = x
        self._x.scatter_forward()
        if self._is_symmetric:
            self._add(self._functions.add_symmetric_product, self._lower, with_ghosts, y)
        if len(self._others.columns):
            self._add(self._functions.add_product, self._others, with_ghosts, y)

    def _add(self, function: Any, blocks: _Blocks, x: np.ndarray, y: np.ndarray) -> None:
        function(
            len(blocks.starts) - 1,
            self._pointer("long long[]", blocks.starts),
            self._pointer("int[]", blocks.columns),
            self._pointer("double[]", blocks.values),
            self._pointer("double[]", x),
            self._pointer("double[]", y),
        )


class _Blocks:
    """Some blocks of this rank's rows of a matrix: which ones, ascending, and their values."""

    def __init__(self, matrix: la.MatrixCSR, chosen: np.ndarray) -> None:
        rows, entries = matrix.index_map(0).size_local, matrix.block_size[0] ** 2
        self._from, self._chosen = matrix.data.reshape(-1, entries), chosen
        self.starts = np.searchsorted(chosen, matrix.indptr[: rows + 1]).astype(np.int64)
        self.columns = matrix.indices[chosen].astype(np.int32)
        self.values = np.empty((len(chosen), entries))

    def take(self) -> None:
        """Copy the matrix's present values."""
        np.take(self._from, self._chosen, axis=0, out=self.values)
