"""The finger as a distributed DOLFINx mesh, and the way back to the mesh file's node order."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import basix.ufl
import numpy as np
from dolfinx import fem, graph, mesh
from dolfinx.io import distribute_entity_data
from dolfinx.io.gmsh import cell_perm_array
from scipy.spatial import cKDTree

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import FingerMesh


@dataclass(frozen=True)
class Domain:
    """A distributed finger.

    Attributes
    ----------
    mesh
        Tetrahedra; linear geometry where the file's mid-nodes halve their edges (its cells are
        then affine and cheap to integrate), quadratic otherwise.
    tissue, surface
        Cell and facet tags with the values of `TISSUES` and `SURFACES`.
    nodes
        The file's nodes (n, 3) in mm, on every rank.
    """

    mesh: mesh.Mesh
    tissue: mesh.MeshTags
    surface: mesh.MeshTags
    nodes: np.ndarray

    @property
    def comm(self) -> MPI.Comm:
        """The communicator of the mesh."""
        return self.mesh.comm

    def cells(self, tag: int) -> np.ndarray:
        """Return this rank's cells (ghosts included) of a tissue tag."""
        return self.tissue.find(tag)

    def file_cells(self) -> np.ndarray:
        """Return the file's index of each owned cell."""
        owned = self.mesh.topology.index_map(3).size_local
        return self.mesh.topology.original_cell_index[:owned]


def create_domain(finger: FingerMesh | None, comm: MPI.Comm) -> Domain:
    """Distribute a finger over the ranks of `comm`.

    Parameters
    ----------
    finger
        The mesh, on rank 0; other ranks may pass None.
    """
    nodes = comm.bcast(finger.nodes if finger is not None and comm.rank == 0 else None)
    straight = comm.bcast(_is_straight(finger) if comm.rank == 0 else None)
    degree = 1 if straight else 2
    element = basix.ufl.element("Lagrange", "tetrahedron", degree, shape=(3,))
    corners = 4 if straight else 10
    permutation = cell_perm_array(mesh.CellType.tetrahedron, corners)
    if comm.rank == 0:
        # An affine mesh must not carry the mid-nodes as unused points.
        used = np.unique(finger.tets[:, :corners])
        index = np.full(len(finger.nodes), -1)
        index[used] = np.arange(len(used))
        x = finger.nodes[used]
        cells = index[finger.tets[:, permutation]]
        facets = index[finger.triangles[:, : 3 if straight else 6]]
        tissue, surface = finger.tissue, finger.surface
    else:
        x, cells = np.empty((0, 3)), np.empty((0, corners), dtype=np.int64)
        facets = np.empty((0, 3 if straight else 6), dtype=np.int64)
        tissue = surface = np.empty(0, dtype=np.int32)
    msh = mesh.create_mesh(comm, cells, element, x)
    if not straight:
        facets = facets[:, cell_perm_array(mesh.CellType.triangle, 6)]
    return Domain(
        msh,
        _tags(msh, 3, cells, tissue, "tissue"),
        _tags(msh, 2, facets, surface, "surface"),
        nodes,
    )


def _is_straight(finger: FingerMesh) -> bool:
    """Tell whether every mid-node halves its edge."""
    edges = [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)]
    points = finger.nodes[finger.tets]
    middle = np.stack([(points[:, a] + points[:, b]) / 2 for a, b in edges], axis=1)
    return bool(np.abs(points[:, 4:] - middle).max() < 1e-9)


def _tags(
    msh: mesh.Mesh, dim: int, entities: np.ndarray, values: np.ndarray, name: str
) -> mesh.MeshTags:
    msh.topology.create_connectivity(dim, 0)
    msh.topology.create_connectivity(dim, 3)
    msh.topology.create_connectivity(3, dim)
    local, local_values = distribute_entity_data(
        msh, dim, np.ascontiguousarray(entities, dtype=np.int64), values.astype(np.int32)
    )
    adjacency = graph.adjacencylist(local)
    tags = mesh.meshtags_from_entities(msh, dim, adjacency, local_values.astype(np.int32))
    tags.name = name
    return tags


class NodeOrder:
    """Carries nodal vectors between a P2 space and the file's node order.

    With 10-node tetrahedra each P2 node is a node of the file, so a vector in this order can be
    read on any number of ranks, and by tools that know nothing of DOLFINx.
    """

    def __init__(self, domain: Domain, space: fem.FunctionSpace) -> None:
        points = space.tabulate_dof_coordinates()
        distance, self._file = cKDTree(domain.nodes).query(points)
        if len(distance) and distance.max() > 1e-6:
            raise MeshError("mesh: a P2 node is not a node of the file; 10-node tetrahedra needed")
        self._owned = space.dofmap.index_map.size_local
        self._count = len(domain.nodes)
        self._comm = domain.comm

    def gather(self, u: fem.Function) -> np.ndarray:
        """Return the nodal vectors (n, 3) in file order, on every rank."""
        values = np.zeros((self._count, 3))
        values[self._file[: self._owned]] = u.x.array.reshape(-1, 3)[: self._owned]
        self._comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def scatter(self, values: np.ndarray, u: fem.Function) -> None:
        """Set `u` from nodal vectors (n, 3) in file order."""
        u.x.array[:] = values[self._file].ravel()
