"""
A finger from a scan of its skin
================================

A layered finger is made from the triangles of a scanned skin, whatever their axes, noise and
unit. Here the scan is derived from the analytic finger, so that the result is known; scaled by 0.75
it is a child's finger. All three are pressed onto a plate.

.. figure:: /pictures/scanned_finger.png

   At 1.5 mm the force is 0.319 N for the analytic finger, 0.309 N for its scan, and 0.551 N for the
   child's finger, which has less tissue over its bone.

Expected time: 3 minutes on one core. It needs the extras ``mesh`` and ``cad``.

What to change: ``finger.skin_file`` (``.stl``, ``.obj`` or ``.ply``), ``finger.file_unit_mm``
(1000 for metres) and ``finger.straight_length_mm``, where the finger is cut; ``finger.bone_file``;
without a bone, ``finger.nail_direction``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/scanned_finger.png'

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from tactile_fem import completed, load_study

# %%
# The scan: skin and bone of a longer finger, with 0.01 mm of noise, turned as on a scanner's table.
# The skin has 4,384 triangles. With 663 it is flatter, and the force is 10 % lower.
# A triangle of the skin belongs to one tetrahedron and not to the cut.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/scanned_finger")
folder.mkdir(parents=True, exist_ok=True)
fine = ["finger.straight_length_mm=18.5", "finger.pad_size_mm=0.5", "finger.far_size_mm=1.0"]
mesh = load_study(overrides=fine).finger.mesh()
corners = mesh.cells[:, :4]
faces = np.concatenate([corners[:, k] for k in ([0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2])])
_, first, count = np.unique(np.sort(faces), axis=0, return_index=True, return_counts=True)
outer = faces[first[count == 1]]
outer = outer[mesh.nodes[outer, 1].max(axis=1) > mesh.nodes[:, 1].min() + 1e-3]
turn, random = Rotation.from_euler("xyz", [0.5, 1.1, 2.0]), np.random.default_rng(0)
for name, triangles in (
    ("skin", mesh.nodes[outer]),
    ("bone", mesh.corners_of("bone_surface")),
):
    scan = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))
    scan.merge_vertices()
    noise = 0.01 * random.normal(size=scan.vertices.shape)
    scan.vertices = turn.apply(scan.vertices + noise)
    scan.export(folder / f"{name}.stl")

# %%
# Tip and nail are found from skin and bone. The smaller finger keeps the thickness of its skin.

scanned = [f"finger.{part}_file={folder / part}.stl" for part in ("skin", "bone")]
small = {
    "file_unit_mm": 1.0,
    "straight_length_mm": 16.0,
    "tip_length_mm": 11.0,
    "contact_from_tip_mm": 12.0,
    "nail_width_mm": 11.0,
    "nail_length_mm": 12.0,
}
child = [f"finger.{key}={0.75 * value}" for key, value in small.items()]
fingers = {"analytic": [], "its scan": scanned, "child": [*scanned, *child]}
press = ["stimulus.kind=plate", "protocol.depth_mm=1.5", "protocol.distance_mm=0"]

figure, (shape, force) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for colour, (name, keys) in enumerate(fingers.items()):
    study = load_study(overrides=[*keys, *press, *sys.argv[2:]])
    results = completed(study, folder / name.replace(" ", "_"))
    trace, finger = results.trace, study.finger.mesh()
    layers = ", ".join(f"{own.mean():.2f}" for own in finger.layer_thickness_mm.values())
    print(
        f"{name}: {len(finger.cells)} tetrahedra, layers of {layers} mm, "
        f"{trace['force_N'][-1, 2]:.3f} N at {trace['depth_mm'][-1]:.2f} mm"
    )
    force.plot(trace["depth_mm"], trace["force_N"][:, 2], f"C{colour}", label=name)
    skin = trimesh.Trimesh(**trimesh.triangles.to_kwargs(finger.corners_of("skin")))
    cut = trimesh.intersections.mesh_plane(skin, (1, 0, 0), (0, 0, 0))
    shape.plot(cut[..., 1].T, cut[..., 2].T, f"C{colour}")
shape.set(xlabel="Y (mm)", ylabel="Z (mm)", aspect="equal", title="Skin in the middle plane")
force.set(xlabel="Depth (mm)", ylabel="Normal force on a plate (N)")
force.legend()
figure.savefig(folder / "scanned_finger.png", dpi=120)
