"""The finger as a distributed DOLFINx mesh, and the mapping to the mesh file's node order."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from mpi4py import MPI

import basix.ufl
import numpy as np
from dolfinx import fem, graph, mesh
from dolfinx.io import distribute_entity_data
from dolfinx.io.gmsh import cell_perm_array
from dolfinx.mesh import Mesh, MeshTags
from scipy.spatial import cKDTree

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, held_parts
from tactile_fem.finger.plane import SPACE, Plane
from tactile_fem.mechanics.rows import gather_rows, scatter_rows
from tactile_fem.runtime.ranks import on_root, shared_errors

logger = logging.getLogger(__name__)

# The finger's cells and facets by their dimension.
_SIMPLEX = {1: mesh.CellType.interval, 2: mesh.CellType.triangle, 3: mesh.CellType.tetrahedron}


@dataclass(frozen=True)
class Domain:
    """The deformable part of a finger, distributed.

    Attributes
    ----------
    mesh
        Tetrahedra (of a section triangles); linear geometry where the file's mid-nodes halve their
        edges (its cells are then affine and cheap to integrate), quadratic otherwise.
    tissue, surface
        Cell and facet tags with the values of `TISSUES` and `SURFACES`.
    nodes
        The file's nodes (n, dimension) in mm, on every rank.
    held
        Whether a node belongs to a fixed part, (n,).
    line
        Number of the skin node above each node of the skin's layers, -1 deeper, (n,).
    file_cells
        The file's index of each cell that was given to DOLFINx.
    cell_count
        Number of the file's cells.
    plane
        Plane of a section.
    fields
        `FingerMesh.fields`, constant in each cell.
    """

    mesh: Mesh
    tissue: MeshTags
    surface: MeshTags
    nodes: np.ndarray
    held: np.ndarray
    line: np.ndarray
    file_cells: np.ndarray
    cell_count: int
    plane: Plane = SPACE
    fields: Mapping[str, fem.Function] = field(default_factory=dict)

    @property
    def comm(self) -> MPI.Comm:
        """The communicator of the mesh."""
        return self.mesh.comm

    def tissues_of(self, tags: MeshTags) -> dict[str, int]:
        """Return name and tag of the tissues in `tags` on any rank.

        All ranks get the same tissues in the same order, so that they create the same forms.
        """
        here = set(tags.values.tolist())
        return {
            name: tag
            for name, tag in TISSUES.items()
            if self.comm.allreduce(tag in here, op=MPI.LOR)
        }

    def skin_by_tissue(self) -> MeshTags:
        """Return the skin's facets, each tagged with its tissue."""
        topology = self.mesh.topology
        dim = topology.dim
        facets = self.surface.find(SURFACES["skin"])
        topology.create_connectivity(dim - 1, dim)
        to_cell = topology.connectivity(dim - 1, dim)
        cells = topology.index_map(dim)
        tissue = np.zeros(cells.size_local + cells.num_ghosts, dtype=np.int32)
        tissue[self.tissue.indices] = self.tissue.values
        values = np.array([tissue[to_cell.links(f)[0]] for f in facets], dtype=np.int32)
        return mesh.meshtags(self.mesh, dim - 1, facets, values)

    def owned_file_cells(self) -> np.ndarray:
        """Return the file's index of each owned cell."""
        topology = self.mesh.topology
        owned = topology.index_map(topology.dim).size_local
        return self.file_cells[topology.original_cell_index[:owned]]


def create_domain(finger: FingerMesh | None, comm: MPI.Comm, held: Sequence[str] = ()) -> Domain:
    """Distribute a finger over the ranks of `comm`.

    Parameters
    ----------
    finger
        The mesh, on rank 0; other ranks may pass None. A section becomes a two-dimensional mesh.
    held
        Tissues and surfaces that are fixed. Cells of fixed tissues are left out: bone is
        a million times stiffer than the tissue around it, so a rigid bone changes only the cost.
    """
    straight, plane, nodes, held_nodes, line, file_cells, values = on_root(
        comm, lambda: _plan(finger, held)
    )
    dim, degree = nodes.shape[1], 1 if straight else 2
    cell, facet = _SIMPLEX[dim], _SIMPLEX[dim - 1]
    corners, sides = math.comb(dim + degree, degree), math.comb(dim - 1 + degree, degree)
    if finger and comm.rank == 0:
        given = finger.cells[file_cells]
        used = np.unique(given[:, :corners])
        index = np.full(len(finger.nodes), -1)
        index[used] = np.arange(len(used))
        x = nodes[used]
        cells = index[given[:, cell_perm_array(cell, corners)]]
        facets = index[finger.facets[:, :sides]]
        facets = facets[:, cell_perm_array(facet, sides)]
        present = np.all(facets >= 0, axis=1)
        facets, surface = facets[present], finger.surface[present]
        tissue = finger.tissue[file_cells]
    else:
        x, cells = np.empty((0, dim)), np.empty((0, corners), dtype=np.int64)
        facets = np.empty((0, sides), dtype=np.int64)
        tissue = surface = np.empty(0, dtype=np.int32)
    element = basix.ufl.element("Lagrange", cell.name, degree, shape=(dim,))
    msh = mesh.create_mesh(comm, cells, element, x)
    return Domain(
        msh,
        _tags(msh, dim, cells, tissue, "tissue"),
        _tags(msh, dim - 1, facets, surface, "surface"),
        nodes,
        held_nodes,
        line,
        file_cells,
        comm.bcast(len(finger.cells) if finger else 0),
        plane,
        {name: _field(msh, name, of_cells) for name, of_cells in values.items()},
    )


def _field(msh: Mesh, name: str, values: np.ndarray) -> fem.Function:
    """Return a field from its values in all cells (m, ...) as they were given to DOLFINx."""
    found = fem.Function(fem.functionspace(msh, ("DG", 0, values.shape[1:])), name=name)
    cells = msh.topology.original_cell_index
    found.x.array.reshape(len(cells), -1)[found.function_space.dofmap.list[:, 0]] = values[
        cells
    ].reshape(len(cells), -1)
    return found


def _plan(
    finger: FingerMesh, held: Sequence[str]
) -> tuple[bool, Plane, np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return straightness, plane, nodes in it, held ones, lines, deformable cells with fields.

    For rank 0.
    """
    rigid, held_nodes = held_parts(finger, held)
    plane, lines = finger.plane, _lines(finger)
    nodes = plane.within(finger.nodes)
    cells = np.flatnonzero(~rigid)
    fields = {name: values[cells] for name, values in finger.fields.items()}
    return _is_straight(finger), plane, nodes, held_nodes, lines, cells, fields


def _lines(finger: FingerMesh) -> np.ndarray:
    """Return the nearest skin node for each node of the skin's layers, -1 for deeper nodes."""
    layers = [TISSUES[name] for name in ("stratum_corneum", "epidermis", "dermis")]
    inside = np.unique(finger.cells[np.isin(finger.tissue, layers)])
    skin = np.unique(finger.facets[finger.surface == SURFACES["skin"]])
    line = np.full(len(finger.nodes), -1)
    line[inside] = skin[cKDTree(finger.nodes[skin]).query(finger.nodes[inside])[1]]
    return line


def _is_straight(finger: FingerMesh) -> bool:
    """Return whether every mid-node halves its edge."""
    shape, points = finger.simplex, finger.nodes[finger.cells]
    middle = points[:, shape.edges].mean(axis=2)
    return bool(np.abs(points[:, shape.corners :] - middle).max() < 1e-9)


def _tags(
    msh: mesh.Mesh, dim: int, entities: np.ndarray, values: np.ndarray, name: str
) -> MeshTags:
    msh.topology.create_connectivity(dim, 0)
    msh.topology.create_connectivity(dim, msh.topology.dim)
    msh.topology.create_connectivity(msh.topology.dim, dim)
    local, local_values = distribute_entity_data(
        msh, dim, np.ascontiguousarray(entities, dtype=np.int64), values.astype(np.int32)
    )
    adjacency = graph.adjacencylist(local)
    tags = mesh.meshtags_from_entities(msh, dim, adjacency, local_values.astype(np.int32))
    tags.name = name
    return tags


def roller(
    V: fem.FunctionSpace, axis: int, where: Callable[[np.ndarray], np.ndarray]
) -> fem.DirichletBC:
    """Return the condition of no displacement along `axis` where `where(x)` is true, x (3, n)."""
    component, _ = V.sub(axis).collapse()
    dofs = fem.locate_dofs_geometrical((V.sub(axis), component), where)
    return fem.dirichletbc(fem.Function(component), dofs, V.sub(axis))


# Larger groups (unstructured meshes) fall apart into single nodes.
_LONGEST_LINE = 24
# Warn if a larger share of the nodes in the skin's layers does so.
_BROKEN_SHARE = 0.1


class NodeOrder:
    """Carries nodal vectors between a P2 space and the file's node order.

    With quadratic cells each P2 node is a node of the file, so a vector in this order can be
    read on any number of ranks, and by tools that know nothing of DOLFINx.
    """

    def __init__(self, domain: Domain, space: fem.FunctionSpace) -> None:
        points = space.tabulate_dof_coordinates()[:, : domain.nodes.shape[1]]
        distance, self._file = cKDTree(domain.nodes).query(points)
        with shared_errors(domain.comm):
            if len(distance) and distance.max() > 1e-6:
                raise MeshError("mesh: a P2 node is not a node of the file; quadratic cells needed")
        self._owned = owned = space.dofmap.index_map.size_local
        # Of all ranks, on the first one.
        self._gathered = gather_rows(domain.comm, self._file[:owned, None])[:, 0]
        self._first = space.dofmap.index_map.local_range[0]
        self._count = len(domain.nodes)
        self._held = domain.held
        self._line = domain.line
        self._comm = domain.comm

    def held_dofs(self) -> np.ndarray:
        """Return this rank's dofs (blocks, ghosts included) of the held nodes."""
        return np.flatnonzero(self._held[self._file]).astype(np.int32)

    def blocks(self) -> list[np.ndarray]:
        """Return this rank's lines of nodes through the skin's layers.

        Every node of the mesh is in one line of one rank; each deeper node is a line of its own.
        A line belongs to the rank that owns its node on the skin, wherever its other nodes are.

        Returns
        -------
        Global block indices, one array (lines, length) for each length.
        """
        number, owner = place = np.full((2, self._count), -1)  # -1: in fixed tissues only
        owned = self._file[: self._owned]
        number[owned] = self._first + np.arange(self._owned)
        owner[owned] = self._comm.rank
        self._comm.Allreduce(MPI.IN_PLACE, place, MPI.MAX)
        head = np.where(self._line >= 0, self._line, np.arange(self._count))
        caring = np.maximum(owner[head], 0)
        mine = np.flatnonzero((number >= 0) & (caring == self._comm.rank))
        groups = _groups(self._line[mine])
        self._warn_of_broken_lines(self._line[mine], groups)
        return [number[mine[group]] for group in groups]

    def _warn_of_broken_lines(self, line: np.ndarray, groups: list[np.ndarray]) -> None:
        """Warn if many nodes of the skin's layers are in no line: multigrid needs the lines."""
        broken = sum(np.sum(line[group] >= 0) for group in groups if group.shape[1] == 1)
        counts = self._comm.allreduce(np.array([broken, np.sum(line >= 0)]))
        if counts[0] > _BROKEN_SHARE * counts[1]:
            logger.warning(
                "%.0f %% of the nodes in the skin's layers are in no line of at most %d nodes "
                "under a node of the skin, as in unstructured layers: multigrid may need several "
                "times the iterations; mesh the layers as columns under the skin's triangles",
                100 * counts[0] / counts[1],
                _LONGEST_LINE,
            )

    def gather(self, u: fem.Function) -> np.ndarray:
        """Return the nodal vectors (n, components) in file order on the first rank.

        Other ranks get none, (0, components). All ranks call.
        """
        return self.gather_owned(self._own(u))

    def keep(self, u: fem.Function) -> Callable[[], np.ndarray]:
        """Return a function that gathers the present vectors whenever it is called."""
        return partial(self.gather_owned, self._own(u).copy())

    def gather_owned(self, vectors: np.ndarray) -> np.ndarray:
        """Return what `gather` does, of vectors at the owned nodes of this rank."""
        rows = gather_rows(self._comm, vectors)
        if self._comm.rank:
            return rows
        values = np.zeros((self._count, vectors.shape[1]))
        values[self._gathered] = rows
        return values

    def scatter(self, values: np.ndarray, u: fem.Function) -> None:
        """Set `u` from nodal vectors (n, components) in file order, needed on the first rank only.

        All ranks call.
        """
        scatter_rows(self._comm, values[self._gathered], self._own(u))
        u.x.scatter_forward()

    def _own(self, u: fem.Function) -> np.ndarray:
        """Return the vectors at the owned nodes of this rank, (owned nodes, components)."""
        size = u.function_space.dofmap.index_map_bs
        return u.x.array.reshape(-1, size)[: self._owned]


def _groups(line: np.ndarray) -> list[np.ndarray]:
    """Return the nodes of lines of equal length as arrays (lines, length)."""
    numbers, inverse, count = np.unique(line, return_inverse=True, return_counts=True)
    single = (numbers[inverse] < 0) | (count[inverse] > _LONGEST_LINE)
    groups = [np.flatnonzero(single)[:, None]]
    order = np.argsort(line, kind="stable")
    length = count[inverse]
    for size in np.unique(length[~single]):
        chosen = order[(length[order] == size) & ~single[order]]
        groups.append(chosen.reshape(-1, size))
    return [group for group in groups if group.size]
