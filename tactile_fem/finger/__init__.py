"""The finger: analytic shape, layered mesh with tags, mesh files, report."""

from tactile_fem.finger.build import build_finger
from tactile_fem.finger.load import load_finger
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
from tactile_fem.finger.msh import read_msh, write_msh
from tactile_fem.finger.report import check_mesh, describe

__all__ = [
    "SURFACES",
    "TISSUES",
    "FingerMesh",
    "build_finger",
    "check_mesh",
    "describe",
    "load_finger",
    "read_msh",
    "write_msh",
]
