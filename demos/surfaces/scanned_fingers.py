# %% [markdown]
# # Fingers from scans
#
# This demo emphasizes
# - how a scan of the skin becomes a layered finger (`finger.skin_file`), whatever its triangles,
#   noise and axes,
# - an anatomical distal phalanx in the place of the analytic bone (`finger.bone_file`),
# - a child's and a large man's finger, by the length of the file's unit (`finger.file_unit_mm`).
#
# The scan is made here: the analytic finger's skin and bone with 0.01 mm of noise, their own
# triangles, turned and shifted as on a scanner's table. So it is known what should come out.
#
#     python demos/surfaces/scanned_fingers.py results/fingers --preset medium
#     mpirun -n 2 python demos/surfaces/scanned_fingers.py results/fingers --preset medium

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from tactile_fem import Results, Study, completed, run_script, write_table
from tactile_fem.finger.build import triangulate
from tactile_fem.finger.shape import bone_shape, skin_shape
from tactile_fem.finger.simplex import gammas
from tactile_fem.output.annotations import INK
from tactile_fem.output.histories import central_receptor
from tactile_fem.runtime.ranks import on_root
from tactile_fem.study import Finger, Output, Protocol

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

PHALANX = Path(__file__).parents[2] / "meshes" / "distal_phalanx.stl"
NOISE_MM = 0.01
TURNED, SHIFTED_MM = Rotation.from_euler("xyz", [0.5, 1.1, 2.0]), np.array([40.0, -25.0, 80.0])


@dataclass(frozen=True)
class Row:
    """A finger's numbers."""

    finger: str
    tetrahedra: int
    least_gamma: float
    corneum_mm: float
    epidermis_mm: float
    dermis_mm: float
    normal_N: float
    tangential_N: float
    largest_sed_kPa: float
    central_sed_kPa: float


# %% [markdown]
# ## The scans
#
# The skin is scanned to 2 mm beyond the cut, where it is open. A finger of another size has its
# lengths scaled, but skin of the same thickness.


# %%
def write_scans(folder: Path) -> None:
    """Write skin and bone as a scanner sees them."""
    finger = Finger(straight_length_mm=Finger().straight_length_mm + 2.0)
    skin = skin_shape(finger)
    noise = np.random.default_rng(0)
    for name, shape, size in (("skin", skin, 0.45), ("bone", bone_shape(finger, skin), 0.6)):
        surface, normals, _ = triangulate(shape, lambda x, y, z, size=size: size)
        points = surface.points + NOISE_MM * noise.normal(size=(len(normals), 1)) * normals
        placed = TURNED.apply(points) + SHIFTED_MM
        trimesh.Trimesh(placed, surface.triangles, process=False).export(folder / f"{name}.stl")


def fingers_of(folder: Path, preset: str) -> dict[str, Finger]:
    """Return the fingers by name."""
    scans = {"skin_file": folder / "skin.stl", "bone_file": folder / "bone.stl"}
    fingers = {
        "analytic": Finger(preset=preset),
        "scanned": Finger(preset=preset, **scans),
        "phalanx": Finger(
            preset=preset, bone_file=PHALANX, file_unit_mm=1100.0, nail_direction=(0, 0, 1)
        ),
    }
    for name, scale in (("child", 0.75), ("large man", 1.2)):
        lengths = {
            key: scale * getattr(Finger(), key)
            for key in ("tip_length_mm", "contact_from_tip_mm", "nail_width_mm", "nail_length_mm")
        }
        fingers[name] = Finger(
            preset=preset,
            **scans,
            **lengths,
            file_unit_mm=scale,
            straight_length_mm=scale * Finger().straight_length_mm,
        )
    return fingers


# %% [markdown]
# ## The comparison


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    depth: float = 1.5,
    distance: float = 2.0,
    only: tuple[str, ...] = (),
) -> None:
    """Press and slide the letters under each finger, and compare.

    Parameters
    ----------
    depth, distance
        Of press and slide, mm.
    only
        Names of the fingers; all if none is given.
    """
    comm = MPI.COMM_WORLD
    on_root(comm, lambda: folder.mkdir(parents=True, exist_ok=True))
    if on_root(comm, lambda: not (folder / "skin.stl").is_file()):
        on_root(comm, lambda: write_scans(folder))
    rows, traces = [], {}
    for name, finger in fingers_of(folder.absolute(), preset).items():
        if only and name not in only:
            continue
        finger = Finger.model_validate(
            {**finger.model_dump(), "pad_size_mm": pad_size, "far_size_mm": far_size}
        )
        study = Study(
            finger=finger,
            protocol=Protocol(depth_mm=depth, distance_mm=distance),
            output=Output(pictures=False),
        )
        results = completed(study, folder / name.replace(" ", "_"), comm=comm)
        if comm.rank == 0:
            rows.append(row_of(name, finger, results))
            traces[name] = results.trace
            print(told(rows[-1], rows[0]), flush=True)
    if comm.rank == 0:
        write_table(folder / "fingers.csv", rows)
        figure_of(traces).savefig(folder / "fingers.png")
        print(folder / "fingers.png")


def row_of(name: str, finger: Finger, results: Results) -> Row:
    """Return a finger's numbers: of its mesh, and at the end of the slide."""
    mesh, trace = finger.mesh(), results.trace
    layers = {layer: float(found.mean()) for layer, found in mesh.layer_thickness_mm.items()}
    force, sed = trace["force_N"], trace["sed_kPa"]
    return Row(
        finger=name,
        tetrahedra=len(mesh.cells),
        least_gamma=float(gammas(mesh.nodes, mesh.cells).min()),
        corneum_mm=layers["stratum_corneum"],
        epidermis_mm=layers["epidermis"],
        dermis_mm=layers["dermis"],
        normal_N=float(force[-1, 2]),
        tangential_N=float(np.hypot(*force[-1, :2])),
        largest_sed_kPa=float(sed.max()),
        central_sed_kPa=float(sed[:, central_receptor(trace["receptors_mm"])].max()),
    )


def told(row: Row, first: Row) -> str:
    """Return a row to print, with what differs from the first."""
    numbers = ("normal_N", "tangential_N", "largest_sed_kPa", "central_sed_kPa")
    values = ", ".join(
        f"{name} {getattr(row, name):.4g} ({100 * (getattr(row, name) / of_first - 1):+.1f} %)"
        for name in numbers
        if (of_first := getattr(first, name))
    )
    return (
        f"{row.finger}: {row.tetrahedra} tetrahedra, gamma {row.least_gamma:.3f}, layers "
        f"{row.corneum_mm:.3f} {row.epidermis_mm:.3f} {row.dermis_mm:.3f} mm, {values}"
    )


def figure_of(traces: dict[str, dict[str, np.ndarray]]) -> Figure:
    """Draw normal force and largest SED of each finger over time."""
    figure = Figure(figsize=(8, 5.5), layout="constrained", dpi=150)
    axes = figure.subplots(2, sharex=True)
    for name, trace in traces.items():
        axes[0].plot(trace["time_s"], trace["force_N"][:, 2], label=name, lw=1)
        axes[1].plot(trace["time_s"], trace["sed_kPa"].max(axis=1), label=name, lw=1)
    axes[0].set_ylabel("Normal force (N)")
    axes[1].set(ylabel="Largest SED (kPa)", xlabel="Time (s)")
    for each in axes:
        each.axvline(0, color=INK, lw=0.5)
    axes[0].legend(fontsize=8)
    return figure


if __name__ == "__main__":
    run_script(main)
