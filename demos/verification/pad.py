# %% [markdown]
# # A half-ellipsoid pad
#
# This demo emphasizes
# - how any mesh of tagged tetrahedra becomes a "finger" of the package (`FingerMesh`),
# - a body that is simple enough to be built with any other code.
#
# The semi-axes are 8 mm across, 10 mm along and 6.5 mm up. The skin of 1 mm is fixed at its flat
# side; the apex is the origin. Skin and core are tagged as epidermis and subcutaneous tissue, so
# that receptors lie between them. The exact volume is $\tfrac23 \pi\, 8 \cdot 10 \cdot 6.5$ mm³;
# with flat facets it is slightly smaller. Meshing needs gmsh.
#
#     python demos/verification/pad.py --size 1.2

# %%
import numpy as np

from tactile_fem import FingerMesh, run_script
from tactile_fem.finger import SURFACES, TISSUES
from tactile_fem.finger.session import gmsh_model, simplices
from tactile_fem.finger.simplex import facets_of, quadratic

AXES_MM = np.array([8.0, 10.0, 6.5])
SKIN_MM = 1.0


# %%
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


# %%
def main(*, size: float = 1.2) -> None:
    """Mesh the pad and print its volume relative to the half ellipsoid; `size` in mm."""
    mesh = half_ellipsoid(size)
    corners = mesh.nodes[mesh.cells[:, :4]]
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6
    exact = 2 / 3 * np.pi * AXES_MM.prod()
    skin = np.count_nonzero(mesh.tissue == TISSUES["epidermis"])
    print(f"tetrahedra {len(mesh.cells)}, in the skin {skin}, nodes {len(mesh.nodes)}")
    print(f"volume {volume:.1f} mm3, {volume / exact:.4f} of the half ellipsoid")


if __name__ == "__main__":
    run_script(main)
