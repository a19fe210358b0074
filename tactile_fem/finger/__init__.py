"""The finger: analytic or scanned, solid or a section; its layered mesh with tags, mesh files."""

from tactile_fem.finger.anatomy import ClosedBone, NailOutline, Skin, SurfaceFiles
from tactile_fem.finger.build import build_finger
from tactile_fem.finger.files import read_mesh, write_mesh
from tactile_fem.finger.finger import MESH_FOLDERS, Finger
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, SkinSurface, describe
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.shape import ARC_END, Capsule, skin_shape
from tactile_fem.finger.simplex import Triangles, lowest_height

__all__ = [
    "ARC_END",
    "MESH_FOLDERS",
    "SURFACES",
    "TISSUES",
    "Capsule",
    "ClosedBone",
    "Finger",
    "FingerMesh",
    "FingerSettings",
    "NailOutline",
    "Skin",
    "SkinSurface",
    "SurfaceFiles",
    "Triangles",
    "build_finger",
    "describe",
    "gmsh_model",
    "lowest_height",
    "read_mesh",
    "simplices",
    "skin_shape",
    "write_mesh",
]
