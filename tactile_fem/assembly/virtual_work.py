"""Virtual work and its derivative in several cells or facets at once.

Integrands, and their derivatives with respect to the unknown and its gradient, come from UFL; the
sums over points and nodes stand in `virtual_work.c`. DOLFINx's own assembly, which takes a cell at
a time and all entries of a symmetric matrix, needs four times as long, see
demos/pages/how/solver.md.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem, la, mesh

from tactile_fem.assembly.at_points import NotAtPointsError, lowered
from tactile_fem.assembly.compile import jit_options as options_for
from tactile_fem.assembly.integrand import Integrand
from tactile_fem.assembly.quadrature import quadrature, reference_normal
from tactile_fem.assembly.tags import with_shared_tags

Array = np.ndarray

_C_TYPES = {
    np.float64: "double[]",
    np.int32: "int[]",
    np.int8: "int8_t[]",
    np.int64: "int64_t[]",
    np.uintp: "uintptr_t[]",
}
_NO_FACETS = np.empty((0, 2), dtype=np.int32)
# Below this a basis function is zero on a facet.
_NO_VALUE = 1e-12


class VirtualWork:
    """A virtual work, linear in a test function, and its derivative.

    Its integrals are over cells or exterior facets; what is not given at points, such as a second
    derivative, is assembled by DOLFINx.

    Parameters
    ----------
    form
        The work. A measure states its quadrature degree; otherwise DOLFINx assembles the integral.
    u, v
        Unknown, a vector field of as many components as the mesh has dimensions, and test function.
    is_symmetric
        Whether the derivative is.
    has_tangent
        Whether the derivative is wanted; without it there is less to compile.
    jit_options
        DOLFINx's; by default those of `assembly.compile.jit_options` without flags.
    entity_maps
        As `dolfinx.fem.form` takes them.
    """

    def __init__(
        self,
        form: ufl.Form,
        u: fem.Function,
        v: ufl.Argument,
        *,
        is_symmetric: bool = False,
        has_tangent: bool = True,
        jit_options: Mapping[str, Any] | None = None,
        entity_maps: Sequence[mesh.EntityMap] = (),
    ) -> None:
        self._u = u
        self._options = {
            "jit_options": options_for(()) if jit_options is None else jit_options,
            "entity_maps": entity_maps,
        }
        groups: defaultdict[tuple[str, Any, int], list[ufl.Integral]] = defaultdict(list)
        for integral in lowered(form).integrals():
            where = integral.integral_type(), integral.subdomain_id(), id(integral.subdomain_data())
            groups[where].append(integral)
        self._parts: list[_Cells] = []
        rest = []
        for integrals in groups.values():
            try:
                integrand = Integrand(
                    integrals,
                    u,
                    v,
                    is_symmetric=is_symmetric,
                    has_tangent=has_tangent,
                    **self._options,
                )
                self._parts += [_Cells(integrand, *part) for part in integrand.parts()]
            except NotAtPointsError:
                rest += integrals
        self._form_of_rest = ufl.Form(rest)
        self._rest = self._compile(self._form_of_rest) if rest else None
        self._positions: list[Array] = []

    def _compile(self, form: ufl.Form) -> fem.Form:
        return fem.form(with_shared_tags(form), **self._options)

    @cached_property
    def _tangent_of_rest(self) -> fem.Form:
        """Compiled if it is needed."""
        return self._compile(ufl.derivative(self._form_of_rest, self._u))

    @property
    def is_at_points(self) -> bool:
        """Whether nothing is left to DOLFINx."""
        return self._rest is None

    def choose(self, facets: Mapping[int, Array]) -> None:
        """Leave out facets but those with the given cells and local facets in turn, by tag.

        What is left out should be zero: DOLFINx assembles all.
        """
        for part in self._parts:
            part.choose(facets)

    def add_residual(self, b: Array) -> None:
        """Add the work at the present state to this rank's vector, ghosts included."""
        for part in self._parts:
            part.add_residual(b)
        if self._rest:
            fem.assemble_vector(b, self._rest)

    def add_tangent(self, matrix: la.MatrixCSR, is_free: Array) -> None:
        """Add the derivative at the present state to a matrix, always the same one.

        Parameters
        ----------
        is_free
            Whether rows and columns of a node are wanted, (nodes,), ghosts included.
        """
        parts = [part for part in self._parts if part.has_tangent]
        if not self._positions:
            wanted = is_free.astype(np.int8)
            self._positions = [part.positions(matrix, wanted) for part in parts]
        for part, positions in zip(parts, self._positions, strict=True):
            part.add_tangent(matrix.data, positions)
        if self._rest:
            fem.assemble_matrix(matrix, self._tangent_of_rest)
            _clear(matrix, ~is_free)


class _Cells:
    """Cells, or cells behind facets, in which an integrand is integrated.

    Parameters
    ----------
    integrand
        The integrand.
    cells
        The cells, ascending.
    facet
        The number of the facets in the cells; None if it is integrated over the cells.
    """

    def __init__(self, integrand: Integrand, cells: Array, facet: int | None = None) -> None:
        self._cells, self._facet = cells, facet
        self._tag, self._c, self._ffi = integrand.tag, integrand.c, integrand.ffi
        self.has_tangent = integrand.has_tangent
        cell = getattr(basix.CellType, integrand.mesh.topology.cell_name())
        points, weights, rules = quadrature(integrand.rules, cell, facet)
        basis = integrand.unknown.values_and_gradients(points)
        shape = integrand.geometry.values_and_gradients(points)[..., 1:]
        tests = np.abs(basis[..., list(integrand.tested)]).max(axis=(0, 2))
        self._is_tested = (tests > _NO_VALUE).astype(np.int8)
        self._nodes = integrand.unknown.dofs(cells)
        self._functions = {"work": integrand.work, "moduli": integrand.moduli}
        # Of each field; C knows the addresses.
        self._fields = {
            "dofs": integrand.dofs(cells, facet, points),
            "values": [field.values for field in integrand.fields],
            "tables": [field.table(points) for field in integrand.fields],
        }
        self._pointers: dict[str, Any] = {}
        self._struct = self._ffi.new("struct cells *")
        self._struct.points = len(weights)
        self._set(weights=weights, rules=rules, basis=basis, shape=np.ascontiguousarray(shape))
        self._set(normal=reference_normal(cell, facet), places=integrand.geometry.values)
        self._set(corners=integrand.geometry.dofs(cells))
        self._set(**{name: _addresses(arrays) for name, arrays in self._fields.items()})
        self._choose(np.arange(len(cells), dtype=np.int32))

    def choose(self, facets: Mapping[int, Array]) -> None:
        """Leave out all facets but those with the given cells and local facets, by tag."""
        pairs = facets.get(self._tag, _NO_FACETS).reshape(-1, 2)
        chosen = np.sort(pairs[pairs[:, 1] == self._facet, 0])
        self._choose(np.searchsorted(self._cells, chosen).astype(np.int32))

    def _choose(self, numbers: Array) -> None:
        self._struct.count = len(numbers)
        self._set(numbers=numbers)

    def add_residual(self, b: Array) -> None:
        """Add the work to a vector."""
        self._take_constants("work")
        self._c.add_residual(self._struct, self._pointer(self._nodes), self._pointer(b))

    def add_tangent(self, blocks: Array, positions: Array) -> None:
        """Add the derivative to the blocks of a matrix."""
        self._take_constants("moduli")
        arrays = self._is_tested, positions, blocks
        self._c.add_tangent(self._struct, *map(self._pointer, arrays))

    def positions(self, matrix: la.MatrixCSR, is_wanted: Array) -> Array:
        """Return the position of the block of each pair of nodes of each cell; -1 if not wanted."""
        found = np.empty((*self._nodes.shape, self._nodes.shape[1]), dtype=np.int32)
        starts, columns = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32)
        arrays = self._nodes, self._is_tested, starts, columns, is_wanted, found
        self._c.locate(len(self._nodes), *map(self._pointer, arrays))
        return found

    def _take_constants(self, name: str) -> None:
        """Have C read the constants that functions of that name take."""
        self._constants = [function.constants() for function in self._functions[name]]
        self._set(constants=_addresses(self._constants))

    def _set(self, **arrays: Array) -> None:
        """Set pointers of the structure in C."""
        for name, array in arrays.items():
            self._pointers[name] = self._pointer(array)
            setattr(self._struct, name, self._pointers[name])

    def _pointer(self, array: Array) -> Any:
        return self._ffi.from_buffer(_C_TYPES[array.dtype.type], array)


def _clear(matrix: la.MatrixCSR, nodes: Array) -> None:
    """Make the blocks in the rows and columns of nodes zero, (nodes,), ghosts included."""
    row = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
    column = matrix.indices[: len(row)]
    matrix.data.reshape(len(matrix.indices), -1)[: len(row)][nodes[row] | nodes[column]] = 0.0


def _addresses(arrays: Sequence[Array]) -> Array:
    return np.array([array.ctypes.data for array in arrays], dtype=np.uintp)
