"""
A button with an engraved arrow
===============================

A finger with an anatomical bone strokes a part from a CAD program: a button 12 mm wide with an
arrow engraved 0.6 mm deep along the finger. Its edges evoke the spikes.

.. figure:: /pictures/button.png

   Two rows of spikes lie along the edges of the shaft, two meet at the tip of the head, 209
   spikes in all. The normal force falls from 0.127 to 0.082 N over the arrow.

Expected time: 5 minutes on one core. It needs the extras ``mesh`` and ``cad``.

What to change: ``stimulus.file`` and ``stimulus.unit_mm`` for your own ``.stl``, ``.obj`` or
``.ply`` file; ``stimulus.edge_radius_mm``; without ``finger.bone_file`` the bone is the analytic
one.
"""

# sphinx_gallery_thumbnail_path = 'pictures/button.png'

import sys
from pathlib import Path

import gmsh
import matplotlib.pyplot as plt

from tactile_fem import completed, load_study

folder = Path(sys.argv[1] if sys.argv[1:] else "results/button")
folder.mkdir(parents=True, exist_ok=True)
file, phalanx = folder / "button.stl", Path(__file__).parents[2] / "meshes/distal_phalanx.stl"
arrow_mm = [(-0.6, -3.5), (0.6, -3.5), (0.6, 0), (2, 0), (0, 3.5), (-2, 0), (-0.6, 0)]

# %%
# Any CAD program would do. Here gmsh cuts the arrow out of a cylinder and writes the triangles of
# the surface, in metres.

gmsh.initialize(["-v", "2"], interruptible=False)
cad = gmsh.model.occ
button = cad.addCylinder(0, 0, -3, 0, 0, 3, 6)
corners = [cad.addPoint(x, y, -0.6) for x, y in arrow_mm]
sides = [cad.addLine(*ends) for ends in zip(corners, corners[1:] + corners[:1], strict=True)]
face = cad.addPlaneSurface([cad.addCurveLoop(sides)])
tool = [entity for entity in cad.extrude([(2, face)], 0, 0, 1) if entity[0] == 3]
cad.cut([(3, button)], tool)
cad.synchronize()
gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 72)
gmsh.option.setNumber("Mesh.ScalingFactor", 1e-3)
gmsh.model.mesh.generate(2)
gmsh.write(str(file))
gmsh.finalize()

# %%
# ``unit_mm`` is the file's unit of length. ``shift_mm`` puts the tail of the arrow over the contact
# point. The bone (``meshes/README.md``) is enlarged by 10 %; Z of its file points to the nail.

overrides = [
    "stimulus.kind=mesh",
    f"stimulus.file={file}",
    "stimulus.unit_mm=1000",
    "stimulus.edge_radius_mm=0.2",
    "stimulus.shift_mm=[0, 4.5]",
    f"finger.bone_file={phalanx}",
    "finger.file_unit_mm=1100",
    "finger.nail_direction=[0, 0, 1]",
    "protocol.depth_mm=1",
    "protocol.distance_mm=9",
    "protocol.output_mm=0.2",
    *sys.argv[2:],
]
results = completed(load_study(overrides=overrides), folder / "scan")

# %%
# The raster, with the arrow.

trace, spikes = results.trace, results.spikes
force = trace["force_N"][trace["phase"] == "slide", 2]
sliding = spikes.time_s > 0
print(f"normal force {force.min():.3f} to {force.max():.3f} N, {sliding.sum()} spikes")
figure, axes = plt.subplots(figsize=(7, 4.6), layout="constrained")
across = trace["receptors_mm"][spikes.receptor[sliding], 0]
axes.plot(spikes.displacement_mm[sliding], across, "k.", ms=2.5)
axes.fill([4.5 + y for _, y in arrow_mm], [x for x, _ in arrow_mm], color="C0", alpha=0.2)
axes.set(xlabel="Displacement (mm)", ylabel="X of the receptor (mm)", aspect="equal")
axes.set(xlim=(0, trace["displacement_mm"][-1]), ylim=(5, -5))
figure.savefig(folder / "button.png", dpi=120)
