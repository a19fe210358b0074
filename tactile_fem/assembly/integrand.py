"""Integrands of a virtual work, and their derivatives, as functions in C.

All integrals over one set of cells or facets make one integrand. It has a function for each rule of
quadrature, as some parts are integrated at fewer points than others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr

from tactile_fem.assembly.at_points import IN_CELLS, AtPoint, NotAtPointsError, Operand, OperandKind
from tactile_fem.assembly.bases import CellField
from tactile_fem.assembly.compile import c_functions
from tactile_fem.assembly.facets import FacetPoints
from tactile_fem.assembly.point_functions import PREAMBLE, PointFunction
from tactile_fem.assembly.quadrature import Rule, quadrature

Array = np.ndarray

# Cells at once: as many numbers as the largest registers hold; of smaller ones it takes several.
_LANES = 8
_FACETS = "exterior_facet"
_ON_FACETS = OperandKind.NORMAL, OperandKind.FACET_DETERMINANT, OperandKind.AT_POINTS
_SCHEMES = "default", "Gauss-Jacobi", "Xiao-Gimbutas"
_SOURCE = Path(__file__).with_name("virtual_work.c")
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


class Integrand:
    """The integrals over one set of cells or facets.

    Parameters
    ----------
    integrals
        Over the same cells or facets.
    u, v
        Unknown and test function.
    is_symmetric
        Whether the derivative is symmetric.
    has_tangent
        Whether the derivative is wanted.
    jit_options
        DOLFINx's.
    entity_maps
        Maps of entities to the submeshes of facets on which fields are known.

    Attributes
    ----------
    tag
        Tag of the cells or facets.
    is_on_facets
        Whether it is integrated over facets.
    rules
        Rules of quadrature.
    work, moduli
        For each rule: factors of the test function and its gradient, and their derivatives with
        respect to the unknown and its gradient.
    has_tangent
        Whether it has a derivative: it is wanted, and is not that of a dead load.
    tested
        What of the test function's value (0) and gradient (1 and more) it contains.
    geometry, unknown, fields
        Position, unknown, and all that is given to the functions.
    c, ffi
        The functions of `virtual_work.c`, and what converts their arguments.

    Raises
    ------
    NotAtPointsError
        It contains what is not given at points.
    """

    def __init__(
        self,
        integrals: Sequence[ufl.Integral],
        u: fem.Function,
        v: ufl.Argument,
        *,
        is_symmetric: bool,
        has_tangent: bool,
        jit_options: Mapping[str, Any],
        entity_maps: Sequence[mesh.EntityMap],
    ) -> None:
        self.mesh = u.function_space.mesh
        if u.ufl_shape != (self.mesh.geometry.dim,) or u.dtype != np.float64:
            raise NotAtPointsError  # virtual_work.c adds blocks of such fields
        self._tags, self.tag = _where(integrals[0])
        self.is_on_facets = integrals[0].integral_type() == _FACETS
        at = AtPoint(u, v)
        self.rules, sums = _by_rule(integrals, at)
        self._facet_points = self._points_of(at.operands, entity_maps)
        trial = at.trial if has_tangent else range(0)
        is_symmetric = is_symmetric and at.tested == trial
        work = [at.work(value) for value in sums]
        moduli = [at.moduli(value, is_symmetric=is_symmetric) for value in sums if trial]
        self.work = [PointFunction(f"work_{i}", value, at) for i, value in enumerate(work)]
        self.moduli = [PointFunction(f"moduli_{i}", value, at) for i, value in enumerate(moduli)]
        self.tested, self.has_tangent = at.tested, bool(trial)
        position = ufl.SpatialCoordinate(self.mesh)
        self.geometry, self.unknown = (
            CellField(Operand(OperandKind.VALUE, of), self.mesh) for of in (position, u)
        )

        self.fields = [CellField(operand, self.mesh) for operand in at.operands]
        in_cells = [own for own in self.fields if own.kind in IN_CELLS]
        self._definitions = _defined(
            DIM=at.dim,
            LANES=_LANES,
            ON_FACETS=int(self.is_on_facets),
            SYMMETRIC=int(is_symmetric),
            CORNERS=self.geometry.nodes,
            NODES=self.unknown.nodes,
            FIELDS=_braced(_braced((own.nodes, own.size, int(own.kind))) for own in self.fields),
            VALUES=max(1, sum(own.nodes * own.size for own in in_cells)),
            WIDTH=sum(at.sizes()),
            TEST=at.tested.start,
            TESTS=len(at.tested),
            TRIAL=trial.start,
            TRIALS=len(trial),
            WORK=_braced(function.name for function in self.work),
            MODULI=_braced([function.name for function in self.moduli] or ["0"]),
        )
        keys = [function.key for function in (*self.work, *self.moduli)]
        self.c, self.ffi = c_functions(
            self.mesh.comm,
            _SOURCE,
            _DECLARATIONS,
            jit_options,
            key=" ".join([self._definitions, *keys]),
            generated=self._generated,
        )

    def _points_of(
        self, operands: Sequence[Operand], entity_maps: Sequence[mesh.EntityMap]
    ) -> FacetPoints | None:
        """Return the points at which fields are known, which are those of the integral."""
        if not self.is_on_facets and {own.kind for own in operands} & set(_ON_FACETS):
            raise NotAtPointsError
        fields = [own.of for own in operands if own.kind == OperandKind.AT_POINTS]
        known = [own.function_space for own in fields if isinstance(own, fem.Function)]
        if not known:
            return None
        found = FacetPoints(known[0], self.mesh, entity_maps)
        facet = getattr(basix.CellType, known[0].mesh.topology.cell_name())
        points, _, rules = quadrature(self.rules, facet, None)
        for space in known:
            own = space.ufl_element().custom_quadrature()[0]
            if space.mesh != known[0].mesh or rules.any() or not np.array_equal(own, points):
                raise NotAtPointsError
        return found

    def _generated(self) -> str:
        """Return what stands before `virtual_work.c`."""
        functions = (*self.work, *self.moduli)
        return "\n".join([self._definitions, PREAMBLE, *(own.code() for own in functions), ""])

    def parts(self) -> list[tuple[Array, int | None]]:
        """Return this rank's cells, or those behind its facets by the number of the facet."""
        topology, tags = self.mesh.topology, self._tags
        own = topology.index_map(topology.dim).size_local
        if not self.is_on_facets:
            cells = np.arange(own, dtype=np.int32) if tags is None else tags.find(self.tag)
            return [(cells[cells < own], None)]
        assert tags is not None
        facets = basix.topology(getattr(basix.CellType, topology.cell_name()))[-2]
        pairs = fem.compute_integration_domains(
            fem.IntegralType.exterior_facet, topology, tags.find(self.tag)
        ).reshape(-1, 2)
        return [(np.sort(pairs[pairs[:, 1] == n, 0]), n) for n in range(len(facets))]

    def dofs(self, cells: Array, facet: int | None, points: Array) -> list[Array]:
        """Return the dofs of each field in cells, or at points of the reference cell on a facet."""
        return [
            self._dofs_at(own, cells, facet, points)
            if own.kind == OperandKind.AT_POINTS
            else own.dofs(cells)
            for own in self.fields
        ]

    def _dofs_at(self, own: CellField, cells: Array, facet: int | None, points: Array) -> Array:
        """Return the dofs of a field that is known at facets' points, in the order of `points`."""
        assert self._facet_points and facet is not None
        rows = self._facet_points.rows(np.column_stack([cells, np.full_like(cells, facet)]))
        basis = self.geometry.values_and_gradients(points)[..., 0]
        here = np.einsum("qn,cni->cqi", basis, self.geometry.values[self.geometry.dofs(cells)])
        return np.take_along_axis(own.dofs(rows), self._facet_points.nearest(rows, here), axis=1)


def _where(integral: ufl.Integral) -> tuple[mesh.MeshTags | None, int]:
    """Return the tags of cells or facets and the wanted one; without tags all cells."""
    tags, tag, kind = integral.subdomain_data(), integral.subdomain_id(), integral.integral_type()
    if kind == "cell" and tag == "everywhere":
        return None, 0
    if kind not in ("cell", _FACETS) or not isinstance(tags, mesh.MeshTags):
        raise NotAtPointsError
    if not isinstance(tag, int | np.integer):
        raise NotAtPointsError
    return tags, int(tag)


def _by_rule(integrals: Sequence[ufl.Integral], at: AtPoint) -> tuple[list[Rule], list[Expr]]:
    """Return the quadratures, degree and scheme, and the sum of the integrands for each."""
    sums: dict[Rule, Expr] = {}
    for integral in integrals:
        metadata = integral.metadata()
        degree, scheme = (
            metadata.get("quadrature_degree"),
            metadata.get("quadrature_rule", "default"),
        )
        if not isinstance(degree, int) or degree < 0 or scheme not in _SCHEMES:
            raise NotAtPointsError
        rule = Rule(degree, scheme)
        value = at(integral.integrand())
        sums[rule] = sums[rule] + value if rule in sums else value
    return list(sums), list(sums.values())


def _defined(**values: int | str) -> str:
    return "\n".join(f"#define {name} {value}" for name, value in values.items())


def _braced(values: Iterable[Any]) -> str:
    return "{" + ", ".join(map(str, values)) + "}"
