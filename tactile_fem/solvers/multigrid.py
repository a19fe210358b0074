"""Two-level multigrid with a line smoother for the thin, stiff layers.

P1 is the coarse space of P2. The smoother is block Jacobi with one block for every vertical line
of nodes through the skin's layers and one for each node below. Point blocks would need ten times
the iterations, because the stratum corneum is thin and a thousand times stiffer than the tissue
below it.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

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
    """

    def __init__(
        self,
        snes: PETSc.SNES,
        fine: fem.FunctionSpace,
        held: np.ndarray,
        lines: list[np.ndarray],
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
        self._smoother = LineJacobi(lines, interpolation.createVecLeft(), size)
        smoother = pc.getMGSmoother(1).getPC()
        smoother.setType("python")
        smoother.setPythonContext(self._smoother)
        self._fine = PETSc.Mat()  # the Jacobian in AIJ format, for the coarse operator
        self._coarse: PETSc.Mat | None = None
        # `FastSolver` decides about set-ups; Newton's method would set up with each Jacobian.
        PETSc.Options(snes.getOptionsPrefix()).setValue("snes_lag_preconditioner", -2)
        snes.setFromOptions()

    @property
    def is_set_up(self) -> bool:
        """Whether it was ever set up."""
        return self._coarse is not None

    def set_up(self, operator: PETSc.Mat, jacobian: PETSc.Mat) -> None:
        """Compute coarse operator and factors, the lines' inverses and the spectral bounds.

        Parameters
        ----------
        operator
            What multiplies.
        jacobian
            The same with entries.
        """
        with common.Timer("tactile: preconditioner"):
            jacobian.convert("aij", out=self._fine)
            self._coarse = self._fine.ptap(self._interpolation, self._coarse)
            self._smoother.invert(jacobian)
            pc = self._snes.getKSP().getPC()
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
    """

    def __init__(self, lines: list[np.ndarray], like: PETSc.Vec, size: int) -> None:
        blocks = np.concatenate([nodes.ravel() for nodes in lines]).astype(np.int32)
        self._size = size
        self._rows = PETSc.IS().createBlock(size, blocks, comm=like.comm)
        self._values = PETSc.Vec().createSeq(size * len(blocks))
        self._result = self._values.duplicate()
        self._scatter = PETSc.Scatter().create(like, self._rows, self._values, None)
        ends = np.cumsum([0, *(size * nodes.size for nodes in lines)]).tolist()
        self._spans = list(pairwise(ends))
        self._sizes = [size * nodes.shape[1] for nodes in lines]
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
        self._inverses = [np.linalg.inv(padded[position]) for position in self._positions]
        # Of single nodes by component: the loop over the nodes is then the innermost.
        for k, inverse in enumerate(self._inverses):
            if inverse.shape[1] == self._size:
                self._inverses[k] = np.moveaxis(np.moveaxis(inverse, 0, -1).copy(), -1, 0)

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
        for (first, end), inverse in zip(self._spans, self._inverses, strict=True):
            blocks, products = (a[first:end].reshape(len(inverse), -1) for a in (given, result))
            if inverse.shape[1] == self._size:
                np.einsum("nij,nj->ni", inverse, blocks, out=products)
            else:
                np.matmul(inverse, blocks[:, :, None], out=products[:, :, None])
        self._scatter.scatter(self._result, y, mode=PETSc.ScatterMode.REVERSE)
