"""Virtual work and its derivative in several cells or facets at once.

Integrands, and their derivatives with respect to displacement and gradient, come from UFL; the sums
over points and nodes stand in `virtual_work.c`. DOLFINx's own assembly, which takes a cell at a
time and all entries of a symmetric matrix, needs four times as long, see
demos/pages/how/solver.md.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem, la
from ufl.core.expr import Expr

from tactile_fem.mechanics.compile import c_functions, jit_options
from tactile_fem.mechanics.problem import Problem
from tactile_fem.solvers.at_points import AtPoint, Given, Kind, NotAtPointsError
from tactile_fem.solvers.bases import CellField
from tactile_fem.solvers.point_functions import PREAMBLE, PointFunction

Array = np.ndarray

# Cells at once: as many numbers as the largest registers hold; of smaller ones it takes several.
_LANES = 8
_SOURCE = Path(__file__).with_suffix(".c")
_DECLARATIONS = """
struct cells {
  int count, points;
  const int *numbers;
  const double *weights;
  const int *rules;
  const uintptr_t *constants;
  const double *shape, *basis, *normal;
  const int *corners;
  const double *places;
  const uintptr_t *dofs, *values, *tables;
};
void add_residual(const struct cells *cells, const int *nodes, double *b);
void add_tangent(const struct cells *cells, const int8_t *is_tested, const int *positions,
                 double *matrix);
void locate(int count, const int *nodes, const int8_t *is_tested, const int64_t *starts,
            const int *columns, const int8_t *is_wanted, int *positions);
"""
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

    Integrals that contain what is not given at points are assembled by DOLFINx.

    Parameters
    ----------
    form
        The work.
    problem
        Displacement, test function, and the body that the form may contain.
    is_symmetric
        Whether the derivative is.
    """

    def __init__(self, form: ufl.Form, problem: Problem, *, is_symmetric: bool = False) -> None:
        obstacle, u = problem.contact.obstacle, problem.u
        groups: defaultdict[tuple[str, Any], list[ufl.Integral]] = defaultdict(list)
        for integral in form.integrals():
            groups[integral.integral_type(), integral.subdomain_id()].append(integral)
        self._parts: list[_Cells] = []
        rest = []
        for integrals in groups.values():
            try:
                integrand = _Integrand(integrals, problem, is_symmetric=is_symmetric)
                self._parts += integrand.in_cells()
            except NotAtPointsError:
                rest += integrals
        self._rest = obstacle.compile(ufl.Form(rest)) if rest else None
        # Compiled if it is needed.
        self._derivative = lambda: obstacle.compile(ufl.derivative(ufl.Form(rest), u))
        self._positions: list[Array] = []

    @cached_property
    def _tangent_of_rest(self) -> fem.Form:
        return self._derivative()

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
        if not self._positions:
            wanted = is_free.astype(np.int8)
            self._positions = [part.positions(matrix, wanted) for part in self._parts]
        for part, positions in zip(self._parts, self._positions, strict=True):
            part.add_tangent(matrix.data, positions)
        if self._rest:
            fem.assemble_matrix(matrix, self._tangent_of_rest)


class _Integrand:
    """The integrals over one set of cells or facets: a function in C for each quadrature."""

    def __init__(
        self,
        integrals: Sequence[ufl.Integral],
        problem: Problem,
        *,
        is_symmetric: bool,
    ) -> None:
        u, self._obstacle = problem.u, problem.contact.obstacle
        self.mesh, self.integral = u.function_space.mesh, integrals[0]
        self.is_on_facets = self.integral.integral_type() == "exterior_facet"
        if not self.is_on_facets and self.integral.integral_type() != "cell":
            raise NotAtPointsError
        at = AtPoint(u, problem.test)
        self.rules, sums = _by_rule(integrals, at)
        is_symmetric = is_symmetric and at.tested == at.trial
        work = [at.work(value) for value in sums]
        moduli = [at.moduli(value, is_symmetric=is_symmetric) for value in sums]
        self.work = [PointFunction(f"work_{i}", value, at) for i, value in enumerate(work)]
        self.moduli = [PointFunction(f"moduli_{i}", value, at) for i, value in enumerate(moduli)]
        self.tested = at.tested
        self.geometry = CellField(Given(Kind.VALUE, ufl.SpatialCoordinate(self.mesh)), self.mesh)
        self.displacement = CellField(Given(Kind.VALUE, u), self.mesh)
        self.fields = [CellField(given, self.mesh) for given in at.given]
        in_cells = [own for own in self.fields if own.kind in (Kind.VALUE, Kind.GRADIENT)]
        if len(self.rules) > 1 and any(own.kind == Kind.AT_POINTS for own in self.fields):
            raise NotAtPointsError
        self._definitions = _defined(
            DIM=at.dim,
            LANES=_LANES,
            ON_FACETS=int(self.is_on_facets),
            SYMMETRIC=int(is_symmetric),
            CORNERS=self.geometry.nodes,
            NODES=self.displacement.nodes,
            FIELDS=_braced(_braced((own.nodes, own.size, int(own.kind))) for own in self.fields),
            VALUES=max(1, sum(own.nodes * own.size for own in in_cells)),
            WIDTH=sum(at.sizes()),
            TEST=at.tested.start,
            TESTS=len(at.tested),
            TRIAL=at.trial.start,
            TRIALS=len(at.trial),
            WORK=_braced(function.name for function in self.work),
            MODULI=_braced(function.name for function in self.moduli),
        )
        keys = [function.key for function in (*self.work, *self.moduli)]
        self.c, self.ffi = c_functions(
            self.mesh.comm,
            _SOURCE,
            _DECLARATIONS,
            jit_options(problem.settings.compiler_flags),
            key=" ".join([self._definitions, *keys]),
            generated=self._generated,
        )

    def _generated(self) -> str:
        """Return what stands before `virtual_work.c`."""
        functions = (*self.work, *self.moduli)
        return "\n".join([self._definitions, PREAMBLE, *(own.code() for own in functions), ""])

    def in_cells(self) -> list[_Cells]:
        """Return this rank's cells, or those behind its facets, by the number of the facet."""
        topology, data, tag = self.mesh.topology, *self._subdomain()
        own = topology.index_map(topology.dim).size_local
        if not self.is_on_facets:
            cells = np.arange(own, dtype=np.int32) if data is None else data.find(tag)
            return [_Cells(self, cells[cells < own])]
        if data is None:
            raise NotAtPointsError
        pairs = fem.compute_integration_domains(
            fem.IntegralType.exterior_facet, topology, data.find(tag)
        ).reshape(-1, 2)
        numbers = range(topology.dim + 1)
        return [_Cells(self, np.sort(pairs[pairs[:, 1] == n, 0]), n) for n in numbers]

    def dofs_at_points(self, own: CellField, cells: Array, facet: int, points: Array) -> Array:
        """Return the dofs of a field that is known at points of facets, in the order of `points`.

        DOLFINx counts them as seen from outside the cells.
        """
        row_of = {tuple(pair): row for row, pair in enumerate(self._obstacle.entities.tolist())}
        rows = np.array([row_of[cell, facet] for cell in cells.tolist()], dtype=np.int32)
        basis = self.geometry.values_and_gradients(points)[..., 0]
        places = self.geometry.values[self.geometry.dofs(cells)]
        here = np.einsum("qn,cni->cqi", basis, places)
        there = self._obstacle.points_mm.reshape(-1, *here.shape[1:])[rows]
        distance = np.linalg.norm(here[:, :, None] - there[:, None], axis=-1)
        return np.take_along_axis(own.dofs(rows), distance.argmin(axis=2), axis=1)

    def _subdomain(self) -> tuple[Any, int]:
        """Return the tags of cells or facets, None for all, and the wanted one."""
        tag = self.integral.subdomain_id()
        if tag == "everywhere":
            return None, 0
        return self.integral.subdomain_data(), tag


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

    def __init__(self, integrand: _Integrand, cells: Array, facet: int | None = None) -> None:
        self._cells, self._facet = cells, facet
        self._tag, self._ffi = integrand.integral.subdomain_id(), integrand.ffi
        self._add_residual, self._add_tangent = integrand.c.add_residual, integrand.c.add_tangent
        self._locate = integrand.c.locate
        cell = getattr(basix.CellType, integrand.mesh.topology.cell_name())
        points, weights, rules = _quadrature(integrand.rules, cell, facet)
        basis = integrand.displacement.values_and_gradients(points)
        jets = list(integrand.tested)
        self._is_tested = np.any(abs(basis[..., jets]) > _NO_VALUE, axis=(0, 2)).astype(np.int8)
        self._nodes = integrand.displacement.dofs(cells)
        self._functions = {"work": integrand.work, "moduli": integrand.moduli}
        self._constants = {
            name: [function.constants() for function in functions]
            for name, functions in self._functions.items()
        }
        fields = integrand.fields
        dofs = [
            own.dofs(cells)
            if own.kind != Kind.AT_POINTS or facet is None
            else integrand.dofs_at_points(own, cells, facet, points)
            for own in fields
        ]
        values, tables = [own.values for own in fields], [own.table(points) for own in fields]
        shape = integrand.geometry.values_and_gradients(points)[..., 1:]
        self._arrays = [*dofs, *values, *tables]  # of which C knows the addresses
        self._struct = self._ffi.new("struct cells *")
        self._struct.points = len(weights)
        self._pointers: dict[str, Any] = {}
        self._set(weights=weights, rules=rules, basis=basis, shape=np.ascontiguousarray(shape))
        self._set(normal=_normal(cell, facet))
        self._set(corners=integrand.geometry.dofs(cells), places=integrand.geometry.values)
        self._set(
            **{
                name: _addresses(arrays)
                for name, arrays in (("dofs", dofs), ("values", values), ("tables", tables))
            }
        )
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
        self._add_residual(self._struct, self._pointer(self._nodes), self._pointer(b))

    def add_tangent(self, blocks: Array, positions: Array) -> None:
        """Add the derivative to the blocks of a matrix."""
        self._take_constants("moduli")
        arrays = self._is_tested, positions, blocks
        self._add_tangent(self._struct, *map(self._pointer, arrays))

    def positions(self, matrix: la.MatrixCSR, is_wanted: Array) -> Array:
        """Return the position of the block of each pair of nodes of each cell; -1 if not wanted."""
        found = np.empty((*self._nodes.shape, self._nodes.shape[1]), dtype=np.int32)
        starts, columns = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32)
        arrays = self._nodes, self._is_tested, starts, columns, is_wanted, found
        self._locate(len(self._nodes), *map(self._pointer, arrays))
        return found

    def _take_constants(self, name: str) -> None:
        """Have C read the constants that functions of that name take."""
        for function, values in zip(self._functions[name], self._constants[name], strict=True):
            values[:] = function.constants()
        self._set(constants=_addresses(self._constants[name]))

    def _set(self, **arrays: Array) -> None:
        """Set pointers of the structure in C."""
        for name, array in arrays.items():
            self._pointers[name] = self._pointer(array)
            setattr(self._struct, name, self._pointers[name])

    def _pointer(self, array: Array) -> Any:
        return self._ffi.from_buffer(_C_TYPES[array.dtype.type], array)


def _by_rule(
    integrals: Sequence[ufl.Integral], at: AtPoint
) -> tuple[list[tuple[int, str]], list[Expr]]:
    """Return the quadratures, degree and scheme, and the sum of the integrands for each."""
    sums: dict[tuple[int, str], Expr] = {}
    for integral in integrals:
        metadata = integral.metadata()
        if not isinstance(metadata.get("quadrature_degree"), int):
            raise NotAtPointsError
        rule = metadata["quadrature_degree"], metadata.get("quadrature_rule", "default")
        value = at(integral.integrand())
        sums[rule] = sums[rule] + value if rule in sums else value
    return list(sums), list(sums.values())


def _quadrature(
    rules: Sequence[tuple[int, str]], cell: basix.CellType, facet: int | None
) -> tuple[Array, Array, Array]:
    """Return points of the reference cell, weights, and the number of the rule of each point."""
    on = cell if facet is None else basix.cell.subentity_types(cell)[-2][facet]
    parts = [
        basix.make_quadrature(on, degree, rule=basix.quadrature.string_to_type(scheme))
        for degree, scheme in rules
    ]
    points, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
    if facet is not None:
        corners = basix.geometry(cell)[basix.topology(cell)[-2][facet]]
        points = corners[0] + points @ (corners[1:] - corners[0])
    numbers = [len(own) for _, own in parts]
    return points, weights, np.repeat(np.arange(len(parts), dtype=np.int32), numbers)


def _normal(cell: basix.CellType, facet: int | None) -> Array:
    """Return the normal of a reference facet, as long as the facet is larger than its own cell."""
    if facet is None:
        return np.zeros(len(basix.geometry(cell)[0]))
    jacobian = basix.cell.facet_jacobians(cell)[facet]
    size = np.sqrt(np.linalg.det(jacobian.T @ jacobian))
    return size * basix.cell.facet_outward_normals(cell)[facet]


def _addresses(arrays: Sequence[Array]) -> Array:
    return np.array([array.ctypes.data for array in arrays], dtype=np.uintp)


def _defined(**values: int | str) -> str:
    return "\n".join(f"#define {name} {value}" for name, value in values.items())


def _braced(values: Iterable[Any]) -> str:
    return "{" + ", ".join(map(str, values)) + "}"
