"""The finger of a study: its mesh is shipped, read from a file, or made."""

from __future__ import annotations

import logging
import tomllib
from pathlib import Path

from tactile_fem.errors import MeshError
from tactile_fem.finger.anatomy import Anatomy
from tactile_fem.finger.build import build_finger
from tactile_fem.finger.files import read_mesh
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.runtime.files import cached_by_content

logger = logging.getLogger(__name__)

_PARENT_FOLDERS = Path(__file__).resolve().parents[2:]
# Beside the package in a clone; when installed in the share folder of the environment, of the
# user (pip --user), of /usr/local (Debian) or of any other folder (pip --target).
MESH_FOLDERS = (
    _PARENT_FOLDERS[0] / "meshes",
    *(folder / "share" / "tactile_fem" / "meshes" for folder in _PARENT_FOLDERS),
)


class Finger(FingerSettings):
    """Shape of the fingertip and of its mesh."""

    def mesh(self) -> FingerMesh:
        """Return the mesh of the finger.

        A `mesh_file` is read. If all values equal those of a shipped recipe, the shipped mesh is
        read. Every other finger is meshed, which needs gmsh.

        Raises
        ------
        MeshError
            The mesh cannot be read, generated or used.
        """
        file = self.mesh_file or self.shipped_file()
        if file is None:
            return build_finger(self)
        if not file.is_file():
            raise MeshError(f"finger.mesh_file = {file} does not exist")
        mesh = read_mesh(file)
        if self.mesh_file is None:
            logger.info("finger from %s", file.name)
        else:
            self.check_mesh(mesh)
        return mesh

    def shipped_file(self) -> Path | None:
        """Return the shipped mesh with this finger as its recipe, if there is one."""
        for folder in MESH_FOLDERS:
            for recipe in sorted(folder.glob("*.toml")):
                mesh = recipe.with_suffix(".npz")
                values = tomllib.loads(recipe.read_text(encoding="utf-8")).get("finger", {})
                if mesh.is_file() and Finger.model_validate(values) == self:
                    return mesh
        return None

    def check_mesh(self, mesh: FingerMesh) -> None:
        """Raise MeshError if your own mesh cannot be used or is of the other kind of finger."""
        mesh.check()
        if mesh.plane.kind != self.kind:
            raise MeshError(
                f'finger.kind is "{self.kind}" but must be "{mesh.plane.kind}" for a mesh of '
                f"{mesh.simplex.plural}"
            )

    def check(self) -> FingerMesh | None:
        """Try within a second what could fail; return the mesh if it is read from a file.

        The last finger is kept: the scans of a series often share it.

        Raises
        ------
        StudyError
            Lengths or scans do not make a finger, a file cannot be read ...
        """
        if self.mesh_file is None:
            Anatomy.of(self)
            if self.shipped_file() is None:
                return None
        return _kept_mesh(self)


_kept_mesh = cached_by_content(maxsize=1)(Finger.mesh)
