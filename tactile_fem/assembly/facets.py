"""Points of quadrature on facets at which fields of a submesh of facets are known."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem, mesh

from tactile_fem.assembly.at_points import NotAtPointsError
from tactile_fem.assembly.compile import expression

Array = np.ndarray


class FacetPoints:
    """The points of quadrature on the facets of a submesh.

    Parameters
    ----------
    space
        Space of quadrature elements on the submesh.
    msh
        The mesh whose facets the submesh has.
    entity_maps
        Among them is that of the two meshes.

    Attributes
    ----------
    points
        Points of the reference facet, (points, dimension).

    Raises
    ------
    NotAtPointsError
        No map belongs to these meshes.
    """

    def __init__(
        self, space: fem.FunctionSpace, msh: mesh.Mesh, entity_maps: Sequence[mesh.EntityMap]
    ) -> None:
        self._mesh, parent, sub = msh, *(own.topology._cpp_object for own in (msh, space.mesh))
        for entity_map in entity_maps:
            both = entity_map.topology._cpp_object, entity_map.sub_topology._cpp_object
            if both[0] is parent and both[1] is sub and entity_map.dim == msh.topology.dim - 1:
                self._map = entity_map
                break
        else:
            raise NotAtPointsError
        self.points: Array = space.ufl_element().custom_quadrature()[0]
        self._position = expression(ufl.SpatialCoordinate(msh), self.points)  # all ranks compile

    @cached_property
    def entities(self) -> Array:
        """Cell and local facet of each facet of the submesh, ghosts included, (facets, 2)."""
        topology, dim = self._map.topology, self._map.topology.dim
        index_map = self._map.sub_topology.index_map(dim - 1)
        count = index_map.size_local + index_map.num_ghosts
        facets = self._map.sub_topology_to_topology(np.arange(count, dtype=np.int32), False)
        topology.create_connectivity(dim - 1, dim)
        topology.create_connectivity(dim, dim - 1)
        to_cell = topology.connectivity(dim - 1, dim)
        to_facet = topology.connectivity(dim, dim - 1)
        cells = [to_cell.links(facet)[0] for facet in facets]
        local = [to_facet.links(c).tolist().index(f) for c, f in zip(cells, facets, strict=True)]
        return np.column_stack([cells, local]).astype(np.int32)

    @cached_property
    def places(self) -> Array:
        """Where the points lie, (facets, points, dimension)."""
        return self.evaluate(self._position)

    def evaluate(self, value: fem.Expression) -> Array:
        """Return a vector at each point, (facets, points, dimension)."""
        shape = len(self.entities), len(self.points), self._mesh.geometry.dim
        return value.eval(self._mesh, self.entities).reshape(shape) if shape[0] else np.empty(shape)

    @cached_property
    def _row_of(self) -> dict[tuple[int, ...], int]:
        return {tuple(pair): row for row, pair in enumerate(self.entities.tolist())}

    def rows(self, entities: Array) -> Array:
        """Return the numbers in the submesh of facets, given as `entities` are."""
        return np.array([self._row_of[tuple(pair)] for pair in entities.tolist()], dtype=np.int32)

    def nearest(self, rows: Array, places: Array) -> Array:
        """Return which of a facet's points lies at each place, both (rows, points).

        DOLFINx counts the points as seen from outside.
        """
        distance = np.linalg.norm(places[:, :, None] - self.places[rows][:, None], axis=-1)
        return distance.argmin(axis=2)
