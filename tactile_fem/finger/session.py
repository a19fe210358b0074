"""Access to gmsh, which runs only while it meshes or reads, and what it fills with cells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from types import ModuleType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError
from tactile_fem.finger.plane import Array
from tactile_fem.finger.simplex import Indices

_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.RandomSeed": 1,
    "Mesh.RandomFactor": 1e-9,
    "Mesh.Renumber": 0,
    "Mesh.Algorithm": 6,  # frontal Delaunay
    "Mesh.Algorithm3D": 10,  # HXT
    "Mesh.Optimize": 0,  # its optimizer does not make the same mesh in every process
    "Mesh.ElementOrder": 1,
    "Mesh.MeshSizeMin": 0,
    "Mesh.MeshSizeMax": 1e22,
    "Mesh.MeshSizeFactor": 1,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeExtendFromBoundary": 0,
}


@contextmanager
def gmsh_model(
    need: str = "a finger of this shape or size has to be meshed",
) -> Iterator[ModuleType]:
    """Provide gmsh with an empty model and silent, reproducible settings; leave it as it was.

    Raises MeshError if gmsh is missing, or fails while meshing.

    Parameters
    ----------
    need
        Begins the sentence if it is missing.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise MeshError(
            f"{need}, and gmsh cannot be loaded ({error}): install it with `pip install gmsh`"
        ) from error
    started = not gmsh.isInitialized()
    if started:
        gmsh.initialize(interruptible=False, readConfigFiles=False)
    old = {name: gmsh.option.getNumber(name) for name in _OPTIONS}
    for name, value in _OPTIONS.items():
        gmsh.option.setNumber(name, value)
    gmsh.model.add("tactile_fem")
    try:
        yield gmsh
    except Exception as error:
        if type(error) is not Exception:  # gmsh raises bare exceptions
            raise
        raise MeshError(f"gmsh could not mesh the finger: {error}") from error
    finally:
        gmsh.model.remove()
        for name, value in old.items():
            gmsh.option.setNumber(name, value)
        if started:
            gmsh.finalize()


def simplices(gmsh: ModuleType, dim: Literal[2, 3]) -> tuple[Array, Indices, Indices]:
    """Return used corners (n, 3), cells (m, dim + 1) and tags of the corners (n,) of the model."""
    tags, flat, _ = gmsh.model.mesh.getNodes()
    _, corners = gmsh.model.mesh.getElementsByType({2: 2, 3: 4}[dim])
    used, cells = np.unique(corners, return_inverse=True)
    order = np.argsort(tags)
    points = flat.reshape(-1, 3)[order[np.searchsorted(tags, used, sorter=order)]]
    return points, cells.reshape(-1, dim + 1).astype(np.int64), used.astype(np.int64)


def fill_plane(nodes: Array, loops: list[NDArray[np.int64]], size: float) -> tuple[Array, Indices]:
    """Triangulate a plane inside the first loop of nodes and outside the second.

    Return all nodes, the new ones last, and the triangles.
    """
    with gmsh_model() as gmsh:
        geo = gmsh.model.geo
        known = np.concatenate(loops)
        for tag in known:
            geo.addPoint(*nodes[tag], tag=int(tag) + 1)
        wires = []
        for loop in loops:
            points = (loop + 1).tolist()
            lines = [geo.addLine(*pair) for pair in pairwise([*points, points[0]])]
            wires.append(geo.addCurveLoop(lines))
            for line in lines:
                geo.mesh.setTransfiniteCurve(line, 2)
        geo.addPlaneSurface(wires)
        geo.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(2)
        # The mesh node of a point has another number.
        own = gmsh.model.mesh.getNodes
        number = {int(own(0, tag + 1)[0][0]): tag for tag in known.tolist()}
        return _with_new_nodes(gmsh, nodes, number, 2)


def fill_volume(
    nodes: Array, shell: list[Indices], holes: Sequence[Indices] = (), *, improve: bool = False
) -> tuple[Array, Indices]:
    """Fill a closed shell of triangles around closed holes with tetrahedra.

    Return all nodes, the new ones last, and the tetrahedra. `improve` removes slivers.
    """
    with gmsh_model() as gmsh:
        mesh = gmsh.model.mesh
        surfaces = [*shell, *holes]
        known = np.unique(np.concatenate(surfaces))
        faces = [gmsh.model.addDiscreteEntity(2) for _ in surfaces]
        mesh.addNodes(2, faces[0], known + 1, nodes[known].ravel())
        for face, triangles in zip(faces, surfaces, strict=True):
            mesh.addElementsByType(face, 2, [], (triangles + 1).ravel())
        loops = [faces[: len(shell)], *([face] for face in faces[len(shell) :])]
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(loop) for loop in loops])
        gmsh.model.geo.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        mesh.generate(3)
        if improve:  # with the optimizer of gmsh if it was built without Netgen, as in Debian
            has_netgen = "Netgen" in gmsh.option.getString("General.BuildOptions")
            mesh.optimize("Netgen" if has_netgen else "", force=True)
        return _with_new_nodes(gmsh, nodes, {k + 1: k for k in known.tolist()}, 3)


def _with_new_nodes(
    gmsh: ModuleType, nodes: Array, number: dict[int, int], dim: Literal[2, 3]
) -> tuple[Array, Indices]:
    """Append the new nodes of gmsh and return the cells in our numbering."""
    points, cells, tags = simplices(gmsh, dim)
    if len(cells) == 0:
        raise MeshError("gmsh left a part of the finger empty: bone and skin may be too near")
    numbers = np.array([number.get(tag, -1) for tag in tags.tolist()])
    new = numbers < 0
    numbers[new] = len(nodes) + np.arange(new.sum())
    return np.vstack([nodes, points[new]]), numbers[cells]
