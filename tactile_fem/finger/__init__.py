"""The finger: analytic or scanned, solid or a section; its layered mesh with tags, mesh files."""

from tactile_fem.finger.build import build_finger
from tactile_fem.finger.deformation import SkinSurface
from tactile_fem.finger.files import read_mesh, write_mesh
from tactile_fem.finger.finger import MESH_FOLDERS, Finger
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, describe
from tactile_fem.finger.simplex import lowest_height

__all__ = [
    "MESH_FOLDERS",
    "SURFACES",
    "TISSUES",
    "Finger",
    "FingerMesh",
    "SkinSurface",
    "build_finger",
    "describe",
    "lowest_height",
    "read_mesh",
    "write_mesh",
]
