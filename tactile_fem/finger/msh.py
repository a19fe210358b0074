"""Reading and writing meshes as Gmsh .msh files, without gmsh."""

from __future__ import annotations

import os
from pathlib import Path

import meshio
import numpy as np

from tactile_fem.errors import MeshError
from tactile_fem.finger.mesh_data import FLAT, SOLID, SURFACES, TISSUES, FingerMesh
from tactile_fem.runtime.files import write_text


def read_msh(path: str | os.PathLike[str]) -> FingerMesh:
    """Read a .msh file of any version; the tags follow from the names of its physical groups.

    Nodes keep the file's order; nodes that belong to no tetrahedron are left out.

    Parameters
    ----------
    path
        A mesh in mm of ten-node tetrahedra and six-node triangles; of a section, of six-node
        triangles and three-node lines.

    Raises
    ------
    MeshError
        The file cannot be read, a part is missing, or its elements are of another order.
    """
    try:
        raw = meshio.gmsh.read(path)
    except OSError as error:
        raise MeshError(f"cannot read the mesh {path}: {error.strerror}") from error
    except Exception as error:  # a damaged file fails in many ways
        reason = str(error).strip() or type(error).__name__
        raise MeshError(
            f"cannot read the mesh {path}: it is no .msh file, or damaged ({reason})"
        ) from error
    kinds = {block.type for block in raw.cells}
    shape = SOLID if SOLID.cell in kinds else FLAT
    if not {shape.cell, shape.facet} <= kinds or kinds & {"tetra", "triangle"}:
        raise MeshError(
            f"the mesh {path} has cells of type {', '.join(sorted(kinds)) or 'none'}: ten-node "
            "tetrahedra and six-node triangles are needed, in a section six-node triangles and "
            "three-node lines (gmsh -order 2)"
        )
    cells, tissue = _tagged(raw, shape.cell, shape.dim, TISSUES)
    facets, surface = _tagged(raw, shape.facet, shape.dim - 1, SURFACES)
    used, flat = np.unique(cells, return_inverse=True)
    mesh = FingerMesh(
        nodes=np.ascontiguousarray(raw.points[used], dtype=np.float64),
        cells=flat.reshape(cells.shape)[:, shape.vtk_order].astype(np.int64),
        tissue=tissue,
        facets=np.searchsorted(used, facets[surface > 0]).astype(np.int64),
        surface=surface[surface > 0],
    )
    if mesh.missing:
        raise MeshError(
            f"the mesh {path} lacks the physical group{'s' * (len(mesh.missing) > 1)} "
            f"{', '.join(mesh.missing)}"
        )
    if np.any(tissue == 0):
        raise MeshError(
            f"{int(np.sum(tissue == 0))} {shape.plural} of {path} belong to no tissue; the "
            f"physical {'volumes' if shape is SOLID else 'surfaces'} are {', '.join(TISSUES)}"
        )
    if not np.all(np.isin(facets[surface > 0], used)):
        raise MeshError(f"the mesh {path} has tagged facets that belong to no {shape.plural}")
    return mesh


def _tagged(
    raw: meshio.Mesh, kind: str, dim: int, tags: dict[str, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells of a type and their tags in this package, 0 for unknown names."""
    number = {
        int(value[0]): tags[name]
        for name, value in raw.field_data.items()
        if int(value[1]) == dim and name in tags
    }
    cells = raw.get_cells_type(kind)
    groups = np.zeros(len(cells))
    if "gmsh:physical" in raw.cell_data:
        groups = raw.get_cell_data("gmsh:physical", kind)
    tagged = np.array([number.get(int(group), 0) for group in groups], dtype=np.int64)
    return cells.astype(np.int64), tagged


def write_msh(path: str | os.PathLike[str], mesh: FingerMesh) -> None:
    """Write a mesh as .msh 2.2 in ASCII; the same mesh gives the same bytes.

    Raises
    ------
    OSError
        It cannot be written; names `path`.
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
        (shape.gmsh_facet, mesh.facets, mesh.surface),
        (shape.gmsh_cell, mesh.cells, mesh.tissue),
    ):
        for cell, tag in zip((cells + 1).tolist(), tags.tolist(), strict=True):
            count += 1
            lines.append(f"{count} {kind} 2 {tag} {tag} {' '.join(map(str, cell))}")
    lines += ["$EndElements", ""]
    write_text(Path(path), "\n".join(lines))
