"""Multigrid with a line smoother for the thin, stiff layers.

P1 is the coarse space of P2. The smoother is block Jacobi with one block for every vertical line
of nodes through the skin's layers and one for each node below. Point blocks would need ten times
the iterations, because the stratum corneum is thin and a thousand times stiffer than the tissue
below it. The equations of P1 are factorized if they are few, and left to smoothed aggregation
with the rigid motions of its aggregates if they are many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx import common, fem, la
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.solvers.coarse import CoarseOperator
from tactile_fem.solvers.line_jacobi import LineJacobi

MULTIGRID_OPTIONS: dict[str, str | int | float | bool] = {
    "pc_type": "mg",
    "pc_mg_levels": 2,
    "pc_use_amat": True,  # the smoother multiplies by the operator, not by its entries
    "pc_mg_galerkin": "none",  # `TwoLevel` makes the coarse operator
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 3,
    "mg_levels_ksp_chebyshev_esteig": "0,0.1,0,1.1",
    "mg_levels_pc_type": "python",
}
_FACTORS: dict[str, str | int | float | bool] = {
    "mg_coarse_pc_type": "lu",
    "mg_coarse_pc_factor_mat_solver_type": "mumps",
    "mg_coarse_mat_mumps_icntl_24": 1,  # the held nodes' rows are empty
}
_AGGREGATION: dict[str, str | int | float | bool] = {
    "mg_coarse_pc_type": "gamg",
    "mg_coarse_pc_gamg_reuse_interpolation": True,  # see `TwoLevel.aggregate`
    "mg_coarse_ksp_type": "gmres",
    "mg_coarse_ksp_rtol": 0.3,
    "mg_coarse_ksp_max_it": 20,
}
# More equations of P1 in space than this are not factorized. Those of a plane always are.
_MOST_TO_FACTORIZE = 20_000


def coarse_options(vertices: int, dim: int) -> dict[str, str | int | float | bool]:
    """Return the options of the coarse level of a mesh with so many vertices in `dim` axes."""
    if dim == 3 and dim * vertices > _MOST_TO_FACTORIZE:
        return _AGGREGATION
    return _FACTORS


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
    matrices
        Their sum is the Jacobian. The columns of the first one contain those of the others.
    jit_options
        Options of the compiler.

    Attributes
    ----------
    is_set_up
        Whether it was ever set up.
    needs_entries
        Whether PETSc's options choose a smoother that is made from the matrix's entries.
    """

    def __init__(
        self,
        snes: PETSc.SNES,
        fine: fem.FunctionSpace,
        held: np.ndarray,
        lines: list[np.ndarray],
        matrices: Sequence[la.MatrixCSR],
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
        self._coarse = CoarseOperator(matrices, interpolation, jit_options)
        self._coarse.matrix.setNearNullSpace(_rigid_motions(coarse))
        like = interpolation.createVecLeft()
        self._smoother = LineJacobi(lines, matrices, like, jit_options)
        smoother = pc.getMGSmoother(1)
        smoother.getPC().setType("python")
        smoother.getPC().setPythonContext(self._smoother)
        self.is_set_up = False
        # `FastSolver` decides about set-ups; Newton's method would set up with each Jacobian.
        PETSc.Options(snes.getOptionsPrefix()).setValue("snes_lag_preconditioner", -2)
        snes.setFromOptions()
        smoother.setFromOptions()
        pc.getMGCoarseSolve().setFromOptions()
        self.needs_entries = smoother.getPC().getType() != "python"

    @property
    def aggregates(self) -> bool:
        """Whether the coarse level is solved by aggregation."""
        return self._snes.getKSP().getPC().getMGCoarseSolve().getPC().getType() == "gamg"

    def aggregate(self) -> None:
        """Choose the aggregates once and for all, by the entries at hand.

        A scan and its continuation have the same only if they choose them at the same state.
        """
        with common.Timer("tactile: preconditioner"):
            self._coarse.update()
            coarse = self._snes.getKSP().getPC().getMGCoarseSolve()
            coarse.setOperators(self._coarse.matrix)
            coarse.setUp()

    def set_up(self, operator: PETSc.Mat, single: PETSc.Mat, jacobian: PETSc.Mat) -> None:
        """Compute coarse operator and factors, the lines' inverses and the spectral bounds.

        Parameters
        ----------
        operator, single
            What multiplies, stored in double and in single precision.
        jacobian
            The same with entries, if `needs_entries`.
        """
        with common.Timer("tactile: preconditioner"):
            self._coarse.update()
            self._smoother.invert()
            pc = self._snes.getKSP().getPC()
            smoother = pc.getMGSmoother(1)
            if not self.needs_entries:
                single.stateIncrease()  # the bounds of its spectrum are computed anew
                smoother.setOperators(single, single)
            pc.getMGCoarseSolve().setOperators(self._coarse.matrix)
            pc.setOperators(operator, jacobian)
            jacobian.stateIncrease()  # else PETSc would leave out the set-up
            pc.setReusePreconditioner(False)
            pc.setUp()
        self.is_set_up = True


def _rigid_motions(space: fem.FunctionSpace) -> PETSc.NullSpace:
    """Return the motions that aggregation has to represent."""
    nodes, size = space.dofmap.index_map.size_local, space.dofmap.index_map_bs
    places = space.tabulate_dof_coordinates()[:nodes, :size].ravel()
    vector = PETSc.Vec().createWithArray(places, bsize=size, comm=space.mesh.comm)
    return PETSc.NullSpace().createRigidBody(vector)
