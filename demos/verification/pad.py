"""A half-ellipsoid pad: simple enough to be built with any other code.

The semi-axes are 8 mm across, 10 mm along and 6.5 mm up. The skin of 1 mm is fixed at its flat
side; the apex is the origin. Skin and core are tagged as epidermis and subcutaneous tissue, so that
receptors lie between them. Meshing needs gmsh.
"""

import numpy as np

from tactile_fem import FingerMesh
from tactile_fem.finger import SURFACES, TISSUES
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.simplex import facets_of, quadratic

AXES_MM = np.array([8.0, 10.0, 6.5])
SKIN_MM = 1.0


def half_ellipsoid(size_mm: float) -> FingerMesh:
    """Return the pad with tetrahedra of about `size_mm`."""
    nodes, tets = _tetrahedra(size_mm)
    core = np.linalg.norm(nodes / (AXES_MM - SKIN_MM), axis=1) < 1 + 1e-6
    tissue = np.where(core[tets].all(axis=1), TISSUES["subcutaneous"], TISSUES["epidermis"])
    facets, first, second = facets_of(tets)
    flat = np.all(nodes[facets, 2] > -1e-9, axis=1)
    tag = np.where(flat, SURFACES["cut"], SURFACES["skin"])
    tag[second >= 0] = SURFACES["interface"]
    boundary = (second < 0) | (tissue[first] != tissue[second])
    nodes[:, 2] += AXES_MM[2]
    nodes, tets, triangles = quadratic(nodes, tets, facets[boundary])
    return FingerMesh(nodes, tets, tissue, triangles, tag[boundary])


def _tetrahedra(size_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (n, 3) and four-node tetrahedra (m, 4) of skin and core, the flat side at 0."""
    with gmsh_model() as gmsh:
        occ, halves = gmsh.model.occ, []
        for semi_axes in (AXES_MM, AXES_MM - SKIN_MM):
            half = (3, occ.addSphere(0, 0, 0, 1, angle1=-np.pi / 2, angle2=0))
            occ.dilate([half], 0, 0, 0, *semi_axes)
            halves.append(half)
        occ.fragment(halves[:1], halves[1:])
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size_mm)
        gmsh.model.mesh.generate(3)
        return simplices(gmsh, 3)[:2]
