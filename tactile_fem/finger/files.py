"""Files of meshes: .npz without gmsh, .msh by gmsh."""

from __future__ import annotations

import os
import re
import zipfile
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
from tactile_fem.finger.plane import Array
from tactile_fem.finger.session import gmsh_model
from tactile_fem.finger.simplex import FLAT, SOLID, Indices
from tactile_fem.runtime.files import atomic_write, write_arrays

# Numbers of lines, triangles and tetrahedra in gmsh.
_LINEAR, _QUADRATIC = {1: 1, 2: 2, 3: 4}, {1: 8, 2: 9, 3: 11}
_VERSION = re.compile(rb"\$MeshFormat\s+([\d.]+)")
_ARRAYS = "nodes", "cells", "tissue", "facets", "surface"
_FIELD = "field_"  # before the name of a field in a .npz file


class _Block(NamedTuple):
    """Elements of one type."""

    kind: int
    nodes: Indices  # (m, n)
    places: Indices  # in the file, (m,)
    groups: frozenset[str]  # physical ones of this dimension, by name


def read_mesh(path: str | os.PathLike[str]) -> FingerMesh:
    """Read a mesh in mm from a .npz file of `write_mesh`, or else as a .msh file, which needs gmsh.

    A .msh file of any version contains ten-node tetrahedra and six-node triangles; of a section,
    six-node triangles and three-node lines. The tags follow from the names of its physical groups.
    Nodes keep their order; nodes that belong to no cell are left out.

    Raises
    ------
    MeshError
        The file cannot be read, a part is missing, or its elements are of another order.
    """
    start = f"the mesh {path}"
    try:
        with open(path, "rb") as file:
            head = file.read(100)
        if head.startswith(b"PK"):  # a .npz file is a .zip file
            return _read_npz(path)
    except OSError as error:
        raise MeshError(f"cannot read {start}: {error.strerror}") from error
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise MeshError(f"cannot read {start}: it is no mesh, or damaged") from error
    version = _VERSION.match(head)
    if not version:  # gmsh would run it as a script
        raise MeshError(f"cannot read {start}: it is no .msh file")
    return _of_blocks(*_read_by_gmsh(path, start, by_number=float(version[1]) < 4), start)


def _read_npz(path: str | os.PathLike[str]) -> FingerMesh:
    with np.load(path, allow_pickle=False) as arrays:
        fields = {
            name.removeprefix(_FIELD): arrays[name]
            for name in arrays.files
            if name.startswith(_FIELD)
        }
        mesh = FingerMesh(**{name: arrays[name] for name in _ARRAYS}, fields=fields)
    indices = np.concatenate([mesh.cells.ravel(), mesh.facets.ravel()])
    if indices.min() < 0 or indices.max() >= len(mesh.nodes):
        raise ValueError
    return mesh


def _read_by_gmsh(
    path: str | os.PathLike[str], start: str, *, by_number: bool
) -> tuple[Array, list[_Block]]:
    """Return the coordinates (n, 3) of the nodes, and the elements by indices of nodes.

    They are in the file's order, which in format 2 is that of their numbers.
    """
    blocks: list[_Block] = []
    with gmsh_model(f"{start} has to be read by gmsh") as gmsh:
        model = gmsh.model
        try:
            gmsh.merge(str(path))
        except Exception as error:  # gmsh raises bare exceptions
            raise MeshError(f"cannot read {start}: {error}") from error
        tags, points, _ = model.mesh.getNodes()
        order = np.argsort(tags) if by_number else np.arange(len(tags))
        index = np.full(int(tags.max(initial=0)) + 1, -1)
        index[tags[order].astype(np.int64)] = np.arange(len(tags))
        count = 0
        for entity in model.getEntities():
            numbers = model.getPhysicalGroupsForEntity(*entity)
            groups = frozenset(model.getPhysicalName(entity[0], n) or str(n) for n in numbers)
            for kind, own, nodes in zip(*model.mesh.getElements(*entity), strict=True):
                rows = index[nodes.astype(np.int64)].reshape(len(own), -1)
                places = own if by_number else count + np.arange(len(own))
                blocks.append(_Block(int(kind), rows, places.astype(np.int64), groups))
                count += len(own)
    return points.reshape(-1, 3)[order], blocks


def _of_blocks(nodes: Array, blocks: list[_Block], start: str) -> FingerMesh:
    """Return the mesh of a file's elements; errors begin with `start`."""
    kinds = {block.kind for block in blocks}
    shape = SOLID if kinds & {_QUADRATIC[3], _LINEAR[3]} else FLAT
    if not {_QUADRATIC[shape.dim], _QUADRATIC[shape.dim - 1]} <= kinds:
        from meshio.gmsh import gmsh_to_meshio_type  # takes a while

        found = sorted(gmsh_to_meshio_type.get(kind, f"number {kind}") for kind in kinds)
        raise MeshError(
            f"{start} has cells of type {', '.join(found) or 'none'}: ten-node "
            "tetrahedra and six-node triangles are needed, in a section six-node triangles and "
            "three-node lines (gmsh -order 2)"
        )
    cells, tissue = _tagged(blocks, shape.dim, TISSUES, start)
    facets, surface = _tagged(blocks, shape.dim - 1, SURFACES, start)
    facets, surface = facets[surface > 0], surface[surface > 0]
    used, flat = np.unique(cells, return_inverse=True)
    mesh = FingerMesh(
        nodes=np.ascontiguousarray(nodes[used], dtype=np.float64),
        cells=flat.reshape(cells.shape).astype(np.int64),
        tissue=tissue,
        facets=np.searchsorted(used, facets).astype(np.int64),
        surface=surface,
    )
    _check_groups(mesh, blocks, start)
    if not np.all(np.isin(facets, used)):
        raise MeshError(f"{start} has tagged facets that belong to no {shape.plural}")
    return mesh


def _check_groups(mesh: FingerMesh, blocks: list[_Block], start: str) -> None:
    """Raise MeshError if a part is missing or cells belong to none."""
    shape = mesh.simplex
    if not any(block.groups for block in blocks):
        raise MeshError(
            f"{start} has no elements in physical groups: gmsh leaves them out of format 2.2 with "
            "Mesh.SaveAll, so save it without that or in format 4.1"
        )
    kinds = _LINEAR[shape.dim], _LINEAR[shape.dim - 1]
    linear = sum(len(b.nodes) for b in blocks if b.kind in kinds and b.groups)
    if linear:
        raise MeshError(
            f"{start} has {linear} linear elements in physical groups beside quadratic ones "
            "(gmsh -order 2)"
        )
    if mesh.missing:
        groups = "groups" if len(mesh.missing) > 1 else "group"
        raise MeshError(f"{start} lacks the physical {groups} {', '.join(mesh.missing)}")
    ungrouped = int(np.sum(mesh.tissue == 0))
    if ungrouped:
        raise MeshError(
            f"{ungrouped} {shape.plural} of {start.removeprefix('the ')} belong to no tissue; the "
            f"physical {'volumes' if shape is SOLID else 'surfaces'} are {', '.join(TISSUES)}"
        )


def _tagged(
    blocks: list[_Block], dim: int, tags: dict[str, int], start: str
) -> tuple[Indices, Indices]:
    """Return quadratic elements, each once, and their only tag in this package, 0 for none."""
    parts = [block for block in blocks if block.kind == _QUADRATIC[dim]]
    cells = np.concatenate([block.nodes for block in parts])
    _, first, number = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    owner = first[number.ravel()]  # format 2 has an element once for each of its groups
    ends = np.cumsum([len(block.nodes) for block in parts])[:-1]
    has_tag = np.zeros((len(tags), len(cells)), dtype=bool)
    for block, rows in zip(parts, np.split(owner, ends), strict=True):
        for elements, name in zip(has_tag, tags, strict=True):
            elements[rows] |= name in block.groups
    if np.any(has_tag.sum(axis=0) > 1):
        raise MeshError(f"{start} has elements in two of the groups {', '.join(tags)}")
    kept = first[np.argsort(np.concatenate([block.places for block in parts])[first])]
    return cells[kept], (np.array([*tags.values()]) @ has_tag)[kept]


def write_mesh(path: str | os.PathLike[str], mesh: FingerMesh) -> None:
    """Write a mesh as .npz, or else as .msh 2.2 in ASCII; the same mesh gives the same bytes.

    Raises an OSError that names `path` if it cannot be written, and a MeshError for fields, such as
    directions of fibres, which only .npz holds.
    """
    if Path(path).suffix == ".npz":
        arrays = {name: getattr(mesh, name) for name in _ARRAYS}
        arrays |= {f"{_FIELD}{name}": values for name, values in mesh.fields.items()}
        return write_arrays(Path(path), arrays, compressed=True)
    if mesh.fields:
        raise MeshError(f"{path}: a .msh file holds no fields ({', '.join(mesh.fields)}); use .npz")
    import meshio  # takes a while

    shape, tags = mesh.simplex, [mesh.surface, mesh.tissue]
    groups = [(n, tag, shape.dim - 1) for n, tag in SURFACES.items() if tag in mesh.surface]
    groups += [(n, tag, shape.dim) for n, tag in TISSUES.items() if tag in mesh.tissue]
    own = meshio.Mesh(
        mesh.nodes,
        [(shape.meshio_facet, mesh.facets), (shape.meshio, mesh.cells[:, shape.vtk_order])],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array(numbers) for name, *numbers in groups},
    )
    with atomic_write(Path(path)) as part:
        own.write(part, "gmsh22", binary=False)
