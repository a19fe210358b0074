"""Reading and writing meshes as Gmsh .msh files, without gmsh."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
from tactile_fem.finger.msh_file import Block, MshFile
from tactile_fem.finger.simplex import FLAT, SOLID, Indices
from tactile_fem.runtime.files import write_text

# Numbers of lines, triangles and tetrahedra in gmsh.
_LINEAR, _QUADRATIC = {1: 1, 2: 2, 3: 4}, {1: 8, 2: 9, 3: 11}


def read_msh(path: str | os.PathLike[str]) -> FingerMesh:
    """Read a .msh file of any version; the tags follow from the names of its physical groups.

    It contains a mesh in mm of ten-node tetrahedra and six-node triangles; of a section, of
    six-node triangles and three-node lines. Nodes keep their order; nodes that belong to no
    cell are left out.

    Raises
    ------
    MeshError
        The file cannot be read, a part is missing, or its elements are of another order.
    """
    try:
        file = MshFile(Path(path))
        names, (nodes, blocks) = file.names(), file.content()
    except OSError as error:
        raise MeshError(f"cannot read the mesh {path}: {error.strerror}") from error
    except Exception as error:  # a damaged file fails in many ways
        reason = str(error).strip() or type(error).__name__
        raise MeshError(
            f"cannot read the mesh {path}: it is no .msh file, or damaged ({reason})"
        ) from error
    kinds = {block.kind for block in blocks}
    shape = SOLID if kinds & {_QUADRATIC[3], _LINEAR[3]} else FLAT
    if not {_QUADRATIC[shape.dim], _QUADRATIC[shape.dim - 1]} <= kinds:
        from meshio.gmsh import gmsh_to_meshio_type  # takes a while

        found = sorted(gmsh_to_meshio_type.get(kind, f"number {kind}") for kind in kinds)
        raise MeshError(
            f"the mesh {path} has cells of type {', '.join(found) or 'none'}: ten-node "
            "tetrahedra and six-node triangles are needed, in a section six-node triangles and "
            "three-node lines (gmsh -order 2)"
        )
    start = f"the mesh {path}"
    cells, tissue = _tagged(blocks, shape.dim, names, TISSUES, start)
    facets, surface = _tagged(blocks, shape.dim - 1, names, SURFACES, start)
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
        raise MeshError(f"the mesh {path} has tagged facets that belong to no {shape.plural}")
    return mesh


def _check_groups(mesh: FingerMesh, blocks: list[Block], start: str) -> None:
    """Raise MeshError if a part is missing or cells belong to none."""
    shape = mesh.simplex
    if not any(block.groups.any() for block in blocks):
        raise MeshError(
            f"{start} has no elements in physical groups: gmsh leaves them out of format 2.2 with "
            "Mesh.SaveAll, so save it without that or in format 4.1"
        )
    kinds = _LINEAR[shape.dim], _LINEAR[shape.dim - 1]
    linear = sum(len(b.nodes) for b in blocks if b.kind in kinds and b.groups.any())
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
    blocks: list[Block],
    dim: int,
    names: dict[tuple[int, int], str],
    tags: dict[str, int],
    start: str,
) -> tuple[Indices, Indices]:
    """Return quadratic elements, each once, and their only tag in this package, 0 for none."""
    numbers = [[k for (d, k), n in names.items() if (d, n) == (dim, name)] for name in tags]
    parts = [block for block in blocks if block.kind == _QUADRATIC[dim]]
    cells = np.concatenate([block.nodes for block in parts])
    _, first, number = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    owner = first[number.ravel()]  # format 2 has an element once for each of its groups
    ends = np.cumsum([len(block.nodes) for block in parts])[:-1]
    has_tag = np.zeros((len(tags), len(cells)), dtype=bool)
    for block, rows in zip(parts, np.split(owner, ends), strict=True):
        for elements, own in zip(has_tag, numbers, strict=True):
            elements[rows[np.isin(block.groups, own).any(axis=1)]] = True
    if np.any(has_tag.sum(axis=0) > 1):
        raise MeshError(f"{start} has elements in two of the groups {', '.join(tags)}")
    kept = np.sort(first)
    return cells[kept], (np.array([*tags.values()]) @ has_tag)[kept]


def write_msh(path: str | os.PathLike[str], mesh: FingerMesh) -> None:
    """Write a mesh as .msh 2.2 in ASCII; the same mesh gives the same bytes.

    Raises an OSError that names `path` if it cannot be written.
    """
    shape = mesh.simplex
    names = [(shape.dim - 1, tag, n) for n, tag in SURFACES.items() if np.any(mesh.surface == tag)]
    names += [(shape.dim, tag, n) for n, tag in TISSUES.items() if np.any(mesh.tissue == tag)]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    lines += [f'{dim} {tag} "{name}"' for dim, tag, name in names]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(mesh.nodes))]
    lines += [f"{i} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1)]
    lines += ["$EndNodes", "$Elements", str(len(mesh.facets) + len(mesh.cells))]
    count = 0
    for kind, cells, tags in (
        (_QUADRATIC[shape.dim - 1], mesh.facets, mesh.surface),
        (_QUADRATIC[shape.dim], mesh.cells, mesh.tissue),
    ):
        for cell, tag in zip((cells + 1).tolist(), tags.tolist(), strict=True):
            count += 1
            lines.append(f"{count} {kind} 2 {tag} {tag} {' '.join(map(str, cell))}")
    lines += ["$EndElements", ""]
    write_text(Path(path), "\n".join(lines))
