"""Fields in the cells of a mesh: their dofs there, and their bases at points."""

from __future__ import annotations

import numpy as np
from dolfinx import fem, mesh

from tactile_fem.assembly.at_points import IN_CELLS, NotAtPointsError, Operand, OperandKind

Array = np.ndarray


class CellField:
    """What is given at points of cells.

    Parameters
    ----------
    operand
        What it is; of the geometry there are no dofs.
    msh
        The mesh.

    Attributes
    ----------
    kind
        Kind of the operand.
    nodes, size
        Number of its basis functions in a cell, and of its components.
    values
        Values of all dofs of this rank; they change with the field.

    Raises
    ------
    NotAtPointsError
        Its components do not share one scalar basis, or it belongs to another mesh.
    """

    def __init__(self, operand: Operand, msh: mesh.Mesh) -> None:
        self.kind, self.nodes, self.size = operand.kind, 0, 0
        self.values, self._dofs = np.empty(0), np.empty((0, 0), dtype=np.int32)
        of = operand.of
        if isinstance(of, fem.Function):
            space = of.function_space
            element, self._dofs, self.size = space.ufl_element(), space.dofmap.list, space.dofmap.bs
            self.values = of.x.array
            is_elsewhere = (space.mesh != msh) != (self.kind == OperandKind.AT_POINTS)
            has_no_gradient = element.is_quadrature and self.kind == OperandKind.GRADIENT
            if is_elsewhere or has_no_gradient or element.block_size != self.size:
                raise NotAtPointsError
        elif of is not None:  # the position
            element = msh.ufl_domain().ufl_coordinate_element()  # type: ignore[union-attr]
            self._dofs, self.size = msh.geometry.dofmaps[0], msh.geometry.dim
            self.values = np.ascontiguousarray(msh.geometry.x[:, : self.size])
        self.nodes = self._dofs.shape[1]
        if self.kind in IN_CELLS:
            self._basis = element.basix_element
            if self._basis.value_size != 1 or not self._basis.dof_transformations_are_identity:
                raise NotAtPointsError

    def dofs(self, cells: Array) -> Array:
        """Return the dofs of some cells, of fields at points those of facets; (cells, nodes)."""
        return np.ascontiguousarray(self._dofs[cells if self.nodes else []], dtype=np.int32)

    def values_and_gradients(self, points: Array) -> Array:
        """Return the basis at points of the reference cell, (points, nodes, 1 + dimension)."""
        found = self._basis.tabulate(1, points)[..., 0]
        return np.ascontiguousarray(np.moveaxis(found, 0, -1))

    def table(self, points: Array) -> Array:
        """Return what of the basis is wanted, (points, nodes) or (points, nodes, dimension)."""
        if self.kind not in IN_CELLS:
            return np.empty(0)
        wanted = 0 if self.kind == OperandKind.VALUE else slice(1, None)
        return np.ascontiguousarray(self.values_and_gradients(points)[..., wanted])
