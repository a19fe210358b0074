"""Products with distributed matrices of dense blocks, of which symmetric ones are read half.

The products of PETSc and DOLFINx take three to ten times as long where no cache holds the matrix,
see demos/pages/how/solver.md.
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
        Options of the compiler.
    is_symmetric
        Whether the matrix is symmetric; then its blocks beyond the diagonal are not read, and each
        row has a diagonal block.
    """

    def __init__(
        self, matrix: la.MatrixCSR, jit_options: Mapping[str, Any], *, is_symmetric: bool = False
    ) -> None:
        self._matrix, self._is_symmetric = matrix, is_symmetric
        size = matrix.block_size[0]
        self._functions, self._pointer = c_functions(
            matrix.index_map(0).comm, _SOURCE, _DECLARATIONS, jit_options, SIZE=size
        )
        self._x = la.vector(matrix.index_map(1), size)
        rows = matrix.index_map(0).size_local
        self._values = matrix.data.reshape(-1, size**2)[: matrix.indptr[rows]]
        self._lower, self._whole = _Blocks(), _Blocks()
        if is_symmetric:
            row = np.repeat(np.arange(rows), np.diff(matrix.indptr[: rows + 1]))
            column = matrix.indices[: len(row)]
            self._lower.choose(matrix, np.flatnonzero(column <= row))
            # Another rank has the rows of ghosts, so what is multiplied by them is read whole.
            self._whole.choose(matrix, np.flatnonzero(column >= rows))

    def take(self) -> None:
        """Copy the matrix's present values; where they are zero only if it is symmetric."""
        if not self._is_symmetric:
            self._whole.choose(self._matrix, np.flatnonzero(self._values.any(axis=1)))
        for blocks in (self._lower, self._whole):
            blocks.take(self._values)

    def add(self, x: np.ndarray, y: np.ndarray) -> None:
        """Add the product with `x` to `y`, both of this rank's rows; all ranks call."""
        with_ghosts = self._x.array
        with_ghosts[: len(x)] = x
        self._x.scatter_forward()
        for function, blocks in (
            (self._functions.add_symmetric_product, self._lower),
            (self._functions.add_product, self._whole),
        ):
            if len(blocks.columns):
                function(
                    len(blocks.starts) - 1,
                    self._pointer("long long[]", blocks.starts),
                    self._pointer("int[]", blocks.columns),
                    self._pointer("double[]", blocks.values),
                    self._pointer("double[]", with_ghosts),
                    self._pointer("double[]", y),
                )


class _Blocks:
    """Some blocks of this rank's rows of a matrix: which ones, ascending, and their values."""

    def __init__(self) -> None:
        self.columns = np.empty(0, dtype=np.int32)

    def choose(self, matrix: la.MatrixCSR, chosen: np.ndarray) -> None:
        """Choose blocks by their positions in the matrix."""
        rows = matrix.index_map(0).size_local
        self._chosen = chosen
        self.starts = np.searchsorted(chosen, matrix.indptr[: rows + 1]).astype(np.int64)
        self.columns = matrix.indices[chosen].astype(np.int32)
        self.values = np.empty((len(chosen), matrix.block_size[0] ** 2))

    def take(self, values: np.ndarray) -> None:
        """Copy the chosen of the matrix's values, (blocks, entries)."""
        if len(self.columns):
            np.take(values, self._chosen, axis=0, out=self.values)
