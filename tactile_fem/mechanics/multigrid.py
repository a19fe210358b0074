"""Two-level multigrid whose smoother sees through the thin, stiff layers.

P1 is the coarse space of P2. The smoother is block Jacobi with one block for every vertical line
of nodes through the skin's layers and one for each node below: point blocks would need ten times
the iterations, because stratum corneum is flat and a thousand times stiffer than the tissue
under it.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

# Larger groups (unstructured meshes) fall apart into single nodes.
_LONGEST_LINE = 24

MULTIGRID_OPTIONS: dict[str, str | int | float | bool] = {
    "pc_type": "mg",
    "pc_mg_levels": 2,
    "pc_mg_galerkin": "both",
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 3,
    "mg_levels_ksp_chebyshev_esteig": "0,0.1,0,1.1",
    "mg_levels_pc_type": "python",
    # The coarse problem is small: solved on each rank it needs no waiting for the others.
    "mg_coarse_pc_type": "redundant",
    "mg_coarse_redundant_pc_type": "lu",
    "mg_coarse_redundant_pc_factor_mat_solver_type": "mumps",
    "mg_coarse_redundant_mat_mumps_icntl_24": 1,
}


def set_up(pc: PETSc.PC, fine: fem.FunctionSpace, held: np.ndarray, line: np.ndarray) -> None:
    """Give PETSc's multigrid its interpolation and its smoother.

    Parameters
    ----------
    pc
        Preconditioner of type "mg" with two levels.
    fine
        The P2 space.
    held
        Blocks (ghosts included) that do not move: nothing is interpolated onto them.
    line
        Number of the vertical line of each block of `fine`, -1 for none.
    """
    coarse = fem.functionspace(fine.mesh, ("Lagrange", 1, (3,)))
    interpolation = fem_petsc.interpolation_matrix(coarse, fine)
    interpolation.assemble()
    owned = fine.dofmap.index_map.size_local
    rows = 3 * held[held < owned][:, None] + np.arange(3)
    first = interpolation.getOwnershipRange()[0]
    interpolation.zeroRows((rows.ravel() + first).astype(np.int32), diag=0.0)
    pc.setMGLevels(2)
    pc.setMGInterpolation(1, interpolation)
    smoother = pc.getMGSmoother(1).getPC()
    smoother.setType("python")
    smoother.setPythonContext(LineJacobi(line[:owned]))


class LineJacobi:
    """Block Jacobi over lines of nodes, a preconditioner for PETSc's Python type.

    Parameters
    ----------
    line
        Number of the line of each owned node, -1 for a block of its own.
    """

    def __init__(self, line: np.ndarray) -> None:
        self._blocks = [3 * nodes[..., None] + np.arange(3) for nodes in _groups(line)]
        self._blocks = [block.reshape(len(block), -1) for block in self._blocks]
        self._positions: list[np.ndarray] = []
        self._inverses: list[np.ndarray] = []
        self._entries = -1

    def setUp(self, pc: PETSc.PC) -> None:
        """Invert the blocks of the rank's diagonal block."""
        matrix = pc.getOperators()[1].getDiagonalBlock()
        starts, columns, values = matrix.getValuesCSR()
        if len(values) != self._entries:
            self._locate(starts, columns, matrix.getSize())
            self._entries = len(values)
        padded = np.append(values, 0.0)
        self._inverses = [np.linalg.inv(padded[position]) for position in self._positions]

    def _locate(self, starts: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> None:
        """Find where the blocks' entries stand among the matrix's values."""
        number = np.arange(1, len(columns) + 1)
        order = scipy.sparse.csr_array((number, columns, starts), shape=shape)
        self._positions = []
        for block in self._blocks:
            rows = np.broadcast_to(block[:, :, None], (*block.shape, block.shape[1]))
            cols = np.broadcast_to(block[:, None, :], rows.shape)
            found = order[rows.ravel(), cols.ravel()]
            found = np.asarray(found.todense() if hasattr(found, "todense") else found)
            self._positions.append(found.reshape(rows.shape) - 1)

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set ``y`` to the block-diagonal inverse times ``x``."""
        del pc
        given = x.getArray(readonly=True)
        result = y.getArray()
        for block, inverse in zip(self._blocks, self._inverses, strict=True):
            result[block] = (inverse @ given[block][..., None])[..., 0]


def _groups(line: np.ndarray) -> list[np.ndarray]:
    """Return the nodes of equally long lines as arrays (lines, length)."""
    numbers, inverse, count = np.unique(line, return_inverse=True, return_counts=True)
    single = (numbers[inverse] < 0) | (count[inverse] > _LONGEST_LINE)
    groups = [np.flatnonzero(single)[:, None]]
    order = np.argsort(line, kind="stable")
    length = count[inverse]
    for size in np.unique(length[~single]):
        chosen = order[(length[order] == size) & ~single[order]]
        groups.append(chosen.reshape(-1, size))
    return [group for group in groups if group.size]
