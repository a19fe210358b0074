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
        Of quadrature elements on the submesh.
    msh
        The mesh whose facets the submesh has.
    entity_maps
        Among them is that of the two meshes.

    Attributes
    ----------
    points
        Of the reference facet, (points, dimension).

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

    @cached_property
    def _entities(self) -> Array:
        return cells_and_local_facets(self._map)

    @cached_property
    def _row_of(self) -> dict[tuple[int, int], int]:
        return {tuple(pair): row for row, pair in enumerate(self._entities.tolist())}

    @cached_property
    def _places(self) -> Array:
        """The points, (facets, points, dimension)."""
        dim = self._mesh.geometry.dim
        position = expression(ufl.SpatialCoordinate(self._mesh), self.points)
        places = position.eval(self._mesh, self._entities) if len(self._entities) else np.empty(0)
        return places.reshape(len(self._entities), len(self.points), dim)

    def rows(self, cells: Array, facet: int) -> Array:
        """Return the numbers in the submesh of that facet of each cell, (cells,)."""
        return np.array([self._row_of[cell, facet] for cell in cells.tolist()], dtype=np.int32)

    def nearest(self, rows: Array, places: Array) -> Array:
        """Return which of a facet's points lies at each place, both (rows, points).

        DOLFINx counts the points as seen from outside.
        """
        distance = np.linalg.norm(places[:, :, None] - self._places[rows][:, None], axis=-1)
        return distance.argmin(axis=2)


def cells_and_local_facets(entity_map: mesh.EntityMap) -> Array:
    """Return cell and local facet of each facet of a submesh, ghosts included, (facets, 2)."""
    topology, dim = entity_map.topology, entity_map.topology.dim
    index_map = entity_map.sub_topology.index_map(dim - 1)
    count = index_map.size_local + index_map.num_ghosts
    facets = entity_map.sub_topology_to_topology(np.arange(count, dtype=np.int32), False)
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    to_cell = topology.connectivity(dim - 1, dim)
    to_facet = topology.connectivity(dim, dim - 1)
    pairs = np.empty((count, 2), dtype=np.int32)
    for row, facet in enumerate(facets):
        cell = to_cell.links(facet)[0]
        pairs[row] = cell, np.flatnonzero(to_facet.links(cell) == facet)[0]
    return pairs
