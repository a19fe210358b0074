"""Access to gmsh, which runs only while a finger is meshed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import MeshError

_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.RandomSeed": 1,
    "Mesh.RandomFactor": 1e-9,
    "Mesh.Renumber": 0,
    "Mesh.Algorithm": 6,  # frontal Delaunay
    "Mesh.Algorithm3D": 10,  # HXT
    "Mesh.ElementOrder": 1,
    "Mesh.MeshSizeMin": 0,
    "Mesh.MeshSizeMax": 1e22,
    "Mesh.MeshSizeFactor": 1,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeExtendFromBoundary": 0,
}


@contextmanager
def gmsh_model() -> Iterator[ModuleType]:
    """Provide gmsh with an empty model and silent, reproducible settings.

    Afterwards, also after an error, the model is removed, and gmsh is finalized if it was started
    here.

    Raises
    ------
    MeshError
        Gmsh is missing, or fails while meshing.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise MeshError(
            f"a finger of this shape or size has to be meshed, and gmsh cannot be loaded ({error}):"
            " install it with `pip install gmsh`, or give finger.mesh_file"
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


def simplices(
    gmsh: ModuleType, dim: Literal[2, 3]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the meshed triangles (`dim` 2) or tetrahedra (3) of the open model.

    Returns
    -------
    points, cells, tags
        (n, 3) used corners in the order of gmsh's tags; (m, dim + 1); (n,) gmsh's tags.
    """
    tags, flat, _ = gmsh.model.mesh.getNodes()
    _, corners = gmsh.model.mesh.getElementsByType({2: 2, 3: 4}[dim])
    used, cells = np.unique(corners, return_inverse=True)
    order = np.argsort(tags)
    points = flat.reshape(-1, 3)[order[np.searchsorted(tags, used, sorter=order)]]
    return points, cells.reshape(-1, dim + 1).astype(np.int64), used.astype(np.int64)
