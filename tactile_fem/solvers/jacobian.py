"""The Jacobian as the sum of two parts, bulk and contact, and products with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx import common, cpp, fem, la

from tactile_fem.assembly import VirtualWork
from tactile_fem.mechanics.problem import Problem
from tactile_fem.solvers.block_products import BlockProduct
from tactile_fem.solvers.frozen_dofs import FrozenDofs

_BLOCKS = la.BlockMode.compact  # type: ignore[attr-defined]


class Jacobian:
    """The derivative of the residual, a matrix of PETSc's Python type.

    Without relaxation the bulk's part derives from a potential and is symmetric. The contact's
    part is not, but concerns only the skin. As they are assembled and multiplied apart, the first
    may be lagged.

    Parameters
    ----------
    problem
        Conditions, and the skin.
    contact
        The contact's work.
    skin
        This rank's cells at the skin that may touch.
    kind
        PETSc's type of `matrix`; None is its default.
    jit_options
        Options of the compiler.

    Attributes
    ----------
    matrix
        `fill` gives it the present entries.
    parts
        Bulk and contact.
    """

    def __init__(
        self,
        problem: Problem,
        contact: VirtualWork,
        skin: np.ndarray,
        kind: str | None,
        jit_options: Mapping[str, Any],
    ) -> None:
        V = problem.u.function_space
        topology = V.mesh.topology
        whole = _pattern(V, np.arange(topology.index_map(topology.dim).size_local))
        self._contact = contact
        self.matrix: PETSc.Mat = cpp.la.petsc.create_matrix(V.mesh.comm, whole, kind)
        self._bulk = la.matrix_csr(whole, block_mode=_BLOCKS)
        self._skin = la.matrix_csr(_pattern(V, skin), block_mode=_BLOCKS)
        self._held, self._held_skin = (
            FrozenDofs(own, problem.bcs) for own in (self._bulk, self._skin)
        )
        self.parts = self._bulk, self._skin
        self._is_symmetric, self._jit_options = problem.bulk.is_symmetric, jit_options
        self._products: list[BlockProduct] = []

    def operators(self) -> list[PETSc.Mat]:
        """Return matrices that multiply, stored in double and in single precision.

        They have no entries, see `fill`, and hold this object.
        """
        are_symmetric = self._is_symmetric, False
        self._products = [
            BlockProduct(self.parts, are_symmetric, real, self._jit_options)
            for real in ("double", "float")
        ]
        rows, size = self._bulk.index_map(0), self._bulk.block_size[0]
        layout = size * rows.size_local, size * rows.size_global
        operators = [
            PETSc.Mat().createPython((layout, layout), context, comm=rows.comm)
            for context in (self, self._products[1])
        ]
        for operator in operators:
            operator.setUp()
        return operators

    def assemble_bulk(self, work: VirtualWork) -> None:
        """Assemble the bulk's part, the derivative of that work, at the present displacement."""
        with common.Timer("tactile: tangent of the bulk"):
            self._bulk.set_value(0.0)
            work.add_tangent(self._bulk, self._held.is_free)
            self._held.set_rows(1.0)
            self._bulk.scatter_reverse()
            self._take(0)

    def assemble_contact(self) -> None:
        """Assemble the contact's part at the present displacement and place of the body."""
        self._skin.set_value(0.0)
        self._contact.add_tangent(self._skin, self._held_skin.is_free)
        self._held_skin.set_rows(0.0)
        self._skin.scatter_reverse()
        self._take(1)

    def _take(self, part: int) -> None:
        for product in self._products:
            product.take(part)

    @contextmanager
    def restored(self) -> Iterator[None]:
        """Restore the bulk's part after the context."""
        before = self._bulk.data.copy()
        try:
            yield
        finally:
            self._bulk.data[:] = before
            self._take(0)

    def fill(self) -> None:
        """Give `matrix` the present entries; all ranks call."""
        matrix = self.matrix
        matrix.zeroEntries()
        # PETSc reads blocks one after the other only if each is stored column by column.
        matrix.setOption(PETSc.Mat.Option.ROW_ORIENTED, False)
        for part in (self._bulk, self._skin):
            own, size = part.index_map(0).size_local, part.block_size[0]
            starts = part.indptr[: own + 1].astype(np.int32)
            columns = part.index_map(1).local_to_global(part.indices[: starts[-1]])
            blocks = part.data.reshape(-1, size, size)[: starts[-1]].swapaxes(1, 2)
            matrix.setValuesBlockedCSR(
                starts, columns.astype(np.int32), blocks.ravel(), PETSc.InsertMode.ADD
            )
        matrix.setOption(PETSc.Mat.Option.ROW_ORIENTED, True)
        matrix.assemble()

    # --- what PETSc calls ------------------------------------------------------------------------

    def mult(self, operator: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set ``y`` to the product with ``x``."""
        self._products[0].mult(operator, x, y)

    def multTranspose(self, operator: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set ``y`` to the transpose's product with ``x``, of which only trust regions need one."""
        self.fill()
        self.matrix.multTranspose(x, y)


def _pattern(V: fem.FunctionSpace, cells: np.ndarray) -> cpp.la.SparsityPattern:
    """Return rows and columns of the dofs that share one of this rank's cells."""
    dofmap = V.dofmap
    nodes, size = dofmap.index_map, dofmap.index_map_bs
    pattern = cpp.la.SparsityPattern(V.mesh.comm, [nodes, nodes], [size, size])
    for dofs in dofmap.list[cells]:
        pattern.insert(dofs, dofs)
    pattern.finalize()
    return pattern
