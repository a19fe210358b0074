"""The finger: analytic or scanned, solid or a section; its layered mesh with tags, mesh files."""

from tactile_fem.finger.build import build_finger
from tactile_fem.finger.finger import MESH_FOLDERS, Finger
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, describe
from tactile_fem.finger.msh import read_msh, write_msh

__all__ = [
    "MESH_FOLDERS",
    "SURFACES",
    "TISSUES",
    "Finger",
    "FingerMesh",
    "build_finger",
    "describe",
    "read_msh",
    "write_msh",
]
