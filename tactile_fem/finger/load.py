"""Provides the mesh of a study: from a file, a shipped one, or a new one."""

from __future__ import annotations

import logging
import tomllib
from pathlib import Path

from tactile_fem.errors import MeshError
from tactile_fem.finger.build import build_finger
from tactile_fem.finger.mesh_data import SOLID, FingerMesh
from tactile_fem.finger.msh import read_msh
from tactile_fem.finger.report import check_mesh
from tactile_fem.finger.section import build_section
from tactile_fem.finger.settings import Finger

logger = logging.getLogger(__name__)

_BESIDE = Path(__file__).resolve().parents[2:]
# Beside the package in a clone; when installed in the share folder of the environment, of the
# user (pip --user), of /usr/local (Debian) or of any other folder (pip --target).
MESH_FOLDERS = (
    _BESIDE[0] / "meshes",
    *(folder / "share" / "tactile_fem" / "meshes" for folder in _BESIDE),
)


def load_finger(finger: Finger) -> FingerMesh:
    """Return the finger's mesh.

    A `mesh_file` is read. If all values equal those of a shipped recipe, the shipped mesh is
    read. Every other finger is meshed, which needs gmsh.

    Raises
    ------
    MeshError
        The mesh cannot be read, generated or used.
    """
    if finger.mesh_file is not None:
        if not finger.mesh_file.is_file():
            raise MeshError(f"finger.mesh_file = {finger.mesh_file} does not exist")
        mesh = read_msh(finger.mesh_file)
        check_mesh(mesh)
        check_kind(mesh, finger)
        return mesh
    shipped = shipped_file(finger)
    if shipped is not None:
        logger.info("finger from %s", shipped.name)
        return read_msh(shipped)
    return build_section(finger) if finger.is_section else build_finger(finger)


def check_kind(mesh: FingerMesh, finger: Finger) -> None:
    """Raise MeshError if a mesh is a section but the study's finger is none, or the reverse."""
    if (mesh.simplex is SOLID) == finger.is_section:
        kind = "solid" if mesh.simplex is SOLID else "section"
        raise MeshError(
            f'finger.kind is "{finger.kind}" but must be "{kind}" for a mesh of '
            f"{mesh.simplex.plural}"
        )


def shipped_file(finger: Finger) -> Path | None:
    """Return the shipped mesh with this finger as its recipe, if there is one."""
    for folder in MESH_FOLDERS:
        for recipe in sorted(folder.glob("*.toml")):
            mesh = recipe.with_suffix(".msh")
            values = tomllib.loads(recipe.read_text(encoding="utf-8")).get("finger", {})
            if mesh.is_file() and Finger.model_validate(values) == finger:
                return mesh
    return None
