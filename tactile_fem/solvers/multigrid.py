"""Two-level multigrid with a line smoother for the thin, stiff layers.

P1 is the coarse space of P2. The smoother is block Jacobi with one block for every vertical line
of nodes through the skin's layers and one for each node below. Point blocks would need ten times
the iterations, because the stratum corneum is thin and a thousand times stiffer than the tissue
below it.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.mechanics.compile import c_functions

_SOURCE = Path(__file__).with_name("line_products.c")
_DECLARATION = "void multiply(int, int, const float *, const double *, double *);"
_WIDTH = 8  # numbers that processors multiply at once

MULTIGRID_OPTIONS: dict[str, str | int | float | bool] = {
    "pc_type": "mg",
    "pc_mg_levels": 2,
    "pc_use_amat": True,  # the smoother multiplies by the operator, not by its entries
    "pc_mg_galerkin": "none",  # `TwoLevel` makes the coarse operator
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 3,
    "mg_levels_ksp_chebyshev_esteig": "0,0.1,0,1.1",
    "mg_levels_pc_type": "python",
    "mg_coarse_pc_type": "lu",
    "mg_coarse_pc_factor_mat_solver_type": "mumps",
    "mg_coarse_pc_precision": "single",
    "mg_coarse_mat_mumps_icntl_24": 1,  # the held nodes' rows are empty
}


class TwoLevel:
    """Coarse operator and smoother for PETSc's multigrid.

    Parameters
    ----------
    snes
        Solver whose preconditioner is of type "mg".
    fine
        The P2 space.
    held
        Blocks (ghosts included) that are fixed: nothing is interpolated to them.
    lines
        This rank's lines of blocks, see `NodeOrder.blocks`.
    jit_options
        Options of the compiler.
    """

    def __init__(
        self,
        snes: PETSc.SNES,
        fine: fem.FunctionSpace,
        held: np.ndarray,
        lines: list[np.ndarray],
        jit_options: Mapping[str, Any],
    ) -> None:
        size = fine.dofmap.index_map_bs
        coarse = fem.functionspace(fine.mesh, ("Lagrange", 1, (size,)))
        interpolation = fem_petsc.interpolation_matrix(coarse, fine)
        interpolation.assemble()
        owned = fine.dofmap.index_map.size_local
        rows = size * held[held < owned][:, None] + np.arange(size)
        first = interpolation.getOwnershipRange()[0]
        interpolation.zeroRows((rows.ravel() + first).astype(np.int32), diag=0.0)
        self._snes = snes
        pc = snes.getKSP().getPC()
        pc.setMGLevels(2)
        pc.setMGInterpolation(1, interpolation)
        self._interpolation = interpolation
        self._smoother = LineJacobi(lines, interpolation.createVecLeft(), size, jit_options)
        smoother = pc.getMGSmoother(1)
        smoother.getPC().setType("python")
        smoother.getPC().setPythonContext(self._smoother)
        self._fine = PETSc.Mat()  # the Jacobian in AIJ format, for the coarse operator
        self._coarse: PETSc.Mat | None = None
        # `FastSolver` decides about set-ups; Newton's method would set up with each Jacobian.
        PETSc.Options(snes.getOptionsPrefix()).setValue("snes_lag_preconditioner", -2)
        snes.setFromOptions()
        smoother.setFromOptions()

    @property
    def is_set_up(self) -> bool:
        """Whether it was ever set up."""
        return self._coarse is not None

    def set_up(self, operator: PETSc.Mat, single: PETSc.Mat, jacobian: PETSc.Mat) -> None:
        """Compute coarse operator and factors, the lines' inverses and the spectral bounds.

        Parameters
        ----------
        operator, single
            What multiplies, in double and in single precision.
        jacobian
            The same with entries.
        """
        with common.Timer("tactile: preconditioner"):
            jacobian.convert("aij", out=self._fine)
            self._coarse = self._fine.ptap(self._interpolation, self._coarse)
            self._smoother.invert(jacobian)
            pc = self._snes.getKSP().getPC()
            smoother = pc.getMGSmoother(1)
            if smoother.getPC().getType() == "python":  # else it may need the entries
                single.stateIncrease()  # the bounds of its spectrum are computed anew
                smoother.setOperators(single, single)
            pc.getMGCoarseSolve().setOperators(self._coarse)
            pc.setOperators(operator, jacobian)
            pc.setReusePreconditioner(False)
            pc.setUp()


class LineJacobi:
    """Block Jacobi over lines of nodes, a preconditioner for PETSc's Python type.

    One rank inverts a complete line even if the partition cuts it, so that the number of
    iterations does not depend on the number of ranks.

    Parameters
    ----------
    lines
        This rank's lines: global block indices, one array (lines, length) for each length.
    like
        A vector with the layout of the matrix's rows.
    size
        Rows of a block.
    jit_options
        Options of the compiler.
    """

    def __init__(
        self, lines: list[np.ndarray], like: PETSc.Vec, size: int, jit_options: Mapping[str, Any]
    ) -> None:
        blocks = np.concatenate([nodes.ravel() for nodes in lines]).astype(np.int32)
        self._size = size
        self._rows = PETSc.IS().createBlock(size, blocks, comm=like.comm)
        self._values = PETSc.Vec().createSeq(size * len(blocks))
        self._result = self._values.duplicate()
        self._scatter = PETSc.Scatter().create(like, self._rows, self._values, None)
        ends = np.cumsum([0, *(size * nodes.size for nodes in lines)]).tolist()
        self._spans = list(pairwise(ends))
        self._sizes = [size * nodes.shape[1] for nodes in lines]
        self._functions, self._pointer = c_functions(
            like.comm.tompi4py(), _SOURCE, _DECLARATION, jit_options, WIDTH=_WIDTH
        )
        self._parts: Any = None
        self._entries = PETSc.Mat()  # the same in AIJ format
        self._positions: list[np.ndarray] = []
        self._inverses: list[np.ndarray] = []

    def invert(self, matrix: PETSc.Mat) -> None:
        """Invert the blocks of `matrix`."""
        self._parts = matrix.createSubMatrices(self._rows, submats=self._parts)
        self._parts[0].convert("aij", out=self._entries)
        starts, columns, values = self._entries.getValuesCSR()
        if not self._positions:
            self._locate(starts, columns)
        padded = np.append(values, 0.0)
        self._inverses = [
            _in_strips(np.linalg.inv(padded[position])) for position in self._positions
        ]

    def _locate(self, starts: np.ndarray, columns: np.ndarray) -> None:
        """Find the positions of the blocks' entries in the matrix's values."""
        number = np.arange(1, len(columns) + 1)
        size = len(starts) - 1
        order = scipy.sparse.csr_array((number, columns, starts), shape=(size, size))
        for (first, end), length in zip(self._spans, self._sizes, strict=True):
            block = np.arange(first, end).reshape(-1, length)
            rows = np.broadcast_to(block[:, :, None], (*block.shape, length))
            found = order[rows.ravel(), np.swapaxes(rows, 1, 2).ravel()]
            found = np.asarray(found.todense() if hasattr(found, "todense") else found)
            self._positions.append(found.reshape(rows.shape) - 1)

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set ``y`` to the block-diagonal inverse times ``x``."""
        self._scatter.scatter(x, self._values)
        given, result = self._values.array_r, self._result.array_w
        for (first, end), length, inverse in zip(
            self._spans, self._sizes, self._inverses, strict=True
        ):
            self._functions.multiply(
                len(inverse),
                length,
                self._pointer("float[]", inverse),
                self._pointer("double[]", given[first:end]),
                self._pointer("double[]", result[first:end]),
            )
        self._scatter.scatter(self._result, y, mode=PETSc.ScatterMode.REVERSE)


def _in_strips(matrices: np.ndarray) -> np.ndarray:
    """Return matrices (lines, length, length) as `line_products.c` reads them."""
    lines, length, _ = matrices.shape
    count = -(-length // _WIDTH)
    strips = np.zeros((lines, count * _WIDTH, length), np.float32)
    strips[:, :length] = matrices
    return np.ascontiguousarray(strips.reshape(lines, count, _WIDTH, length).swapaxes(2, 3))
