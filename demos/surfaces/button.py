# %% [markdown]
# # A fingertip strokes a button with an engraved arrow
#
# This demo emphasizes
# - how a rigid part comes from a CAD program: as triangles in an STL file, in any unit,
# - how the study places it and rounds its edges,
# - an anatomical bone in the finger (`finger.bone_file`),
# - how `tactile-fem preview` shows finger and part before the scan.
#
# The button is 12 mm wide. Its arrow is engraved 0.6 mm deep and points along the finger. The
# finger is pressed down beside the arrow's tail and slides along it to its tip.
#
#     python demos/surfaces/button.py results/button
#     mpirun -n 2 python demos/surfaces/button.py results/button
#     python demos/surfaces/button.py results/short --distance 0.4

# %%
from pathlib import Path

import numpy as np

from tactile_fem import Results, Study, draw, run_script, scan
from tactile_fem.study import Finger, Mesh, Protocol, Receptors

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)


# %% [markdown]
# ## The part
#
# Any CAD program would do. Here gmsh cuts an arrow out of a cylinder and writes the triangles of
# the surface, in metres.

# %%
PHALANX = Path(__file__).parents[2] / "meshes" / "distal_phalanx.stl"
ARROW_MM = [(-0.6, -3.5), (0.6, -3.5), (0.6, 0), (2, 0), (0, 3.5), (-2, 0), (-0.6, 0)]


def write_button(file: Path) -> None:
    """Write the button as an STL file, its axis along z, in metres."""
    import gmsh

    gmsh.initialize(["-v", "2"], interruptible=False)
    cad = gmsh.model.occ
    button = cad.addCylinder(0, 0, -3, 0, 0, 3, 6)
    corners = [cad.addPoint(x, y, -0.6) for x, y in ARROW_MM]
    sides = [cad.addLine(*ends) for ends in zip(corners, corners[1:] + corners[:1], strict=True)]
    arrow = cad.addPlaneSurface([cad.addCurveLoop(sides)])
    tool = [entity for entity in cad.extrude([(2, arrow)], 0, 0, 1) if entity[0] == 3]
    cad.cut([(3, button)], tool)
    cad.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 72)
    gmsh.option.setNumber("Mesh.ScalingFactor", 1e-3)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(file))
    gmsh.finalize()


# %% [markdown]
# ## The study
#
# The bone is a distal phalanx from MyoHub's models (`meshes/README.md`), in metres and ten percent
# larger; its file's Z points to the nail. `unit_mm` is the length of the part's unit. The part's
# middle lies over the contact point, so `shift_mm` puts the arrow's tail there. Edges are rounded
# to 0.2 mm, as injection moulding does, which needs walls and gaps of more than twice that.


# %%
def study_of(file: Path, depth: float, distance: float) -> Study:
    """Return the study of a slide over the button."""
    return Study(
        finger=Finger(bone_file=PHALANX, file_unit_mm=1100.0, nail_direction=(0.0, 0.0, 1.0)),
        stimulus=Mesh(
            file=file, unit_mm=1000.0, edge_radius_mm=0.2, shift_mm=(0.0, 4.5), friction=0.4
        ),
        protocol=Protocol(depth_mm=depth, distance_mm=distance),
        receptors=Receptors(half_width_mm=4.0, spacing_mm=0.2),
    )


# %% [markdown]
# ## The scan


# %%
def main(folder: Path, *, depth: float = 1.0, distance: float = 9.0) -> None:
    """Write the button, slide over it, and print what was felt."""
    comm = MPI.COMM_WORLD
    file = folder / "button.stl"
    if comm.rank == 0 and not file.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_button(file)
    comm.barrier()
    result = scan(study_of(file, depth, distance), folder / "scan")
    if comm.rank == 0:
        tell(result)
        for figure in draw(folder / "scan"):
            print(figure)


# %%
def tell(result) -> None:
    """Print the numbers of a scan."""
    trace = Results.open(result.folder).trace
    slide = trace["time_s"] >= 0
    force = trace["force_N"][slide]
    k, receptor = np.unravel_index(
        np.argmax(trace["sed_kPa"][slide]), trace["sed_kPa"][slide].shape
    )
    x = trace["receptors_mm"][receptor, 0]
    print(f"normal force        {force[:, 2].min():.3f} to {force[:, 2].max():.3f} N")
    print(
        f"largest SED         {trace['sed_kPa'][slide][k, receptor]:.3f} kPa at X {x:.1f} mm, "
        f"displacement {trace['displacement_mm'][slide][k]:.1f} mm"
    )
    print(f"spikes              {sum(map(len, result.response.spikes))}")


# %%
if __name__ == "__main__":
    run_script(main)
