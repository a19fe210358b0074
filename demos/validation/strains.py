# %% [markdown]
# # Strains of ridged skin under a plate and under an edge
#
# Optical coherence tomography of living fingers (Corniani et al. 2025, eLife 93554) finds less than
# 10 % compression of the stratum corneum and more than 20 % of the epidermis at 3.5 N on a flat
# plate, most of it by 0.5 N, and flattened ridges; an edge 1 mm wide and 0.3 mm high shears the
# skin
# on its two sides oppositely. A section has force per width: 0.5 N over 9 mm and 3.5 N over 14 mm,
# the widths of the contact of a solid finger. Nothing is fitted to them.
#
#     python demos/validation/strains.py results/strains
#     python demos/validation/strains.py results/quick --forces 0.01 --edge-force 0.01

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from tactile_fem import FingerMesh, Study, completed, run_script, write_table
from tactile_fem.finger import SURFACES, TISSUES
from tactile_fem.study import Finger

Array = NDArray[np.float64]

EDGE = {"kind": "grating", "count": 1, "ridge_mm": 1.0, "relief_mm": 0.3, "fillet_radius_mm": 0.1}
RIDGED = {"ridge_height_mm": 0.1, "papilla_depth_mm": 0.2}
# The layers of the fingers measured, with the intermediate ridges in the epidermis.
IN_VIVO = {"stratum_corneum_mm": 0.38, "epidermis_mm": 0.27, "ridge_height_mm": 0.1}
SKINS: dict[str, dict[str, Any]] = {
    "smooth": {},
    "ridged": RIDGED,
    "ridged, layers in vivo": IN_VIVO,
}
LAYERS = "stratum_corneum", "epidermis"
# Half of the skin that counts; the sides of the edge begin and end so far from its middle.
_NEAR_MM, _SIDE_MM = 2.0, (0.5, 1.5)


@dataclass(frozen=True)
class Row:
    """A skin under a plate, and on the two sides of an edge."""

    skin: str
    force_N_mm: float
    corneum_compression: float
    epidermis_compression: float
    ridges_left: float


@dataclass(frozen=True)
class Sides:
    """Mean shear of the layers towards the middle, on the two sides of an edge, and their area."""

    skin: str
    layer: str
    proximal_shear: float
    distal_shear: float
    area_change: float


# %%
def main(
    folder: Path,
    *,
    forces: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (0.055, 0.25),
    edge_force: float = 0.06,
    pad_size: float = 0.06,
) -> None:
    """Press a plate and an edge on smooth and ridged skin; forces in N/mm, element edge in mm."""
    rows, sides = [], []
    for name, skin in SKINS.items():
        finger = Finger(kind="section", pad_size_mm=pad_size, **skin)
        mesh = finger.mesh()
        short = name.replace(", ", "_").replace(" ", "_")
        for force in forces:
            u = pressed(folder / f"{short}_plate_{force:g}", finger, {"kind": "plate"}, force)
            rows.append(under_plate(name, force, mesh, u))
            r = rows[-1]
            print(
                f"plate, {name}, {force:g} N/mm: compression {100 * r.corneum_compression:.1f} % "
                f"(stratum corneum), {100 * r.epidermis_compression:.1f} % (epidermis); "
                f"{100 * r.ridges_left:.0f} % of the ridges' height left"
            )
        u = pressed(folder / f"{short}_edge", finger, EDGE, edge_force)
        for layer in LAYERS:
            sides.append(beside_edge(name, layer, mesh, u))
            s = sides[-1]
            print(
                f"edge, {name}, {layer}: shear {s.proximal_shear:+.3f} and {s.distal_shear:+.3f}, "
                f"area {100 * s.area_change:+.1f} %"
            )
    write_table(folder / "plate.csv", rows)
    write_table(folder / "edge.csv", sides)


def pressed(folder: Path, finger: Finger, stimulus: dict[str, Any], force_N_mm: float) -> Array:
    """Press; return the displacement of the mesh's nodes in the plane, (n, 2) mm."""
    study = Study.model_validate(
        {
            "finger": finger,
            "stimulus": stimulus,
            "protocol": {"force_N": force_N_mm, "press_speed_mm_s": 1.0, "distance_mm": 0.0},
            "receptors": {"spacing_mm": 1.0},
            "solver": {"linear": "direct", "contact_width_MPa": 0.02},
            "output": {"pictures": False},
        }
    )
    return completed(study, folder).load_checkpoint()["u"]


# %%
def deformation_gradients(finger: FingerMesh, displacement_mm: Array, tissue: str) -> Array:
    """Return F (cells, d, d) at the centres of the cells of a tissue; d is 2 in a section.

    `displacement_mm` (n, d) is that of the nodes.
    """
    cells, shape = finger.cells[finger.tissue == TISSUES[tissue]], finger.simplex
    corners = finger.plane.within(finger.nodes)[cells[:, : shape.corners]]
    edges = corners[:, 1:] - corners[:, :1]
    slopes = shape.gradients(np.full(shape.corners, 1 / shape.corners))
    gradient = np.einsum("na,cni->cia", slopes, displacement_mm[cells])
    # The inverse of the edges is the gradient of the reference coordinates, transposed.
    return np.eye(shape.dim) + gradient @ np.swapaxes(np.linalg.inv(edges), 1, 2)


def principal_strains(finger: FingerMesh, displacement_mm: Array, tissue: str) -> Array:
    """Return the principal strains (cells, d), stretch less 1, in increasing order."""
    F = deformation_gradients(finger, displacement_mm, tissue)
    return np.linalg.svd(F, compute_uv=False)[:, ::-1] - 1


def centres(finger: FingerMesh, tissue: str) -> Array:
    """Return the centres (cells, 3) of the undeformed cells of a tissue, mm."""
    cells = finger.cells[finger.tissue == TISSUES[tissue], : finger.simplex.corners]
    return finger.nodes[cells].mean(axis=1)


def under_contact(finger: FingerMesh, tissue: str, half_mm: float) -> NDArray[np.bool_]:
    """Return which cells of a tissue lie within `half_mm` of the contact point, X and Y."""
    at = centres(finger, tissue)
    palmar = at[:, 2] < np.median(finger.nodes[:, 2])
    return palmar & np.all(np.abs(at[:, :2]) < half_mm, axis=1)


# %%
def under_plate(name: str, force: float, mesh: FingerMesh, u: Array) -> Row:
    """Return how the layers are compressed and the ridges flattened near the contact point."""
    compression = [
        float(-principal_strains(mesh, u, layer)[under_contact(mesh, layer, _NEAR_MM), 0].mean())
        for layer in LAYERS
    ]
    return Row(name, force, *compression, ridges_left(mesh, u))


def ridges_left(mesh: FingerMesh, u: Array) -> float:
    """Return the height of the ridges near the contact point over what it was; nan if smooth."""
    skin = np.unique(mesh.facets[mesh.surface == SURFACES["skin"], :2])
    at = mesh.plane.within(mesh.nodes)
    near = skin[(np.abs(at[skin, 0]) < _NEAR_MM) & (at[skin, 1] < 2.0)]

    def height(places: Array) -> float:
        # What the pad's own curve leaves, twice the mean square of a wave, is its height.
        line = np.polyfit(places[:, 0], places[:, 1], 4)
        rest = places[:, 1] - np.polyval(line, places[:, 0])
        return float(2 * np.sqrt(2 * np.mean(rest**2)))

    before = height(at[near])
    return height((at + u)[near]) / before if before > 0.01 else float("nan")


def beside_edge(name: str, layer: str, mesh: FingerMesh, u: Array) -> Sides:
    """Return the shear of a layer on the two sides of the edge, and the change of its area."""
    F = deformation_gradients(mesh, u, layer)
    at = centres(mesh, layer)
    palmar = under_contact(mesh, layer, _SIDE_MM[1])
    # Green and Lagrange's shear along the skin and upright, which turning does not change.
    shear = np.einsum("cki,ckj->cij", F, F)[:, 0, 1]
    beside = palmar & (np.abs(at[:, 1]) > _SIDE_MM[0])
    proximal, distal = (shear[beside & (np.sign(at[:, 1]) == side)].mean() for side in (-1, 1))
    return Sides(
        name, layer, float(proximal), float(distal), float(np.linalg.det(F[palmar]).mean() - 1)
    )


if __name__ == "__main__":
    run_script(main)
