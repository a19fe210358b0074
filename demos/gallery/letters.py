"""
Letters under the finger
========================

A fingertip is pressed 1.97 mm deep onto the embossed letters F G H, which then slide 10 mm at 20
mm/s with friction 0.3, as in `Hamasaki et al. (2020)
<https://doi.org/10.1177/1687814020984651>`_. The script prints forces, strain energy density
(SED), spikes and cost, and runs on any number of MPI ranks.

.. figure:: /pictures/letters_deformed.png

   The finger after 6.4 mm, cut open, with its strain energy density.

Expected time: 3 minutes on one core.

What to change: ``stimulus.text``, ``protocol.depth_mm``, ``stimulus.friction``, or the mesh
(``finger.preset=medium``).
"""

# sphinx_gallery_thumbnail_path = 'pictures/letters.png'

import shutil
import sys
from pathlib import Path

import numpy as np

from tactile_fem import completed, draw, load_study

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

# %%
# Every key of a study has a default; arguments after the folder replace some.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/letters")
study = load_study(overrides=["stimulus.text=FGH", *sys.argv[2:]])
results = completed(study, folder)

# %%
# ``trace`` holds one row for each step, from first touch to the end of the slide.


def print_numbers() -> None:
    """Print forces, drive, spikes and cost."""
    trace, run = results.trace, results.run
    slide = trace["phase"] == "slide"
    normal, along = trace["force_N"][slide, 2], -trace["force_N"][slide, 1]
    middle = np.argmin(np.linalg.norm(trace["receptors_mm"][:, :2], axis=1))
    sed = trace["sed_kPa"][slide, middle]
    steps, newton = len(trace["time_s"]) - 1, trace["newton_iterations"].sum()
    print(f"normal force in the slide   {normal.min():.4f} to {normal.max():.4f} N")
    print(f"tangential / normal, end    {along[-1] / normal[-1]:.4f}")
    print(f"SED of the middle receptor  {sed.min():.4f} to {sed.max():.4f} kPa")
    print(f"spikes                      {len(results.spikes.time_s)}")
    print(f"tetrahedra, unknowns        {run['mesh']['tetrahedra']}, {run['mesh']['unknowns']}")
    print(f"steps, Newton iterations    {steps}, {newton}")
    print(f"ranks, wall time            {run['ranks']}, {run['wall_s']:.0f} s")


# %%
# Only one rank prints and draws.

if MPI.COMM_WORLD.rank == 0:
    print_numbers()
    for figure in draw(results):
        print(figure)
    shutil.copy(folder / "figures" / "raster.png", folder / "letters.png")

# %%
# .. figure:: /pictures/letters.png
#
#    Spikes of 51 receptors across the finger, over the passing letter.
#
# ``mpirun -n 2 python demos/gallery/letters.py results/two
# finger.pad_size_mm=3 finger.far_size_mm=6 protocol.distance_mm=1`` prints
#
# .. code-block:: text
#
#    normal force in the slide   0.4428 to 0.4667 N
#    tangential / normal, end    0.3806
#    SED of the middle receptor  0.3007 to 0.4096 kPa
#    spikes                      149
#    tetrahedra, unknowns        2899, 11871
#    steps, Newton iterations    35, 239
#    ranks, wall time            2, 12 s
#
# On one rank the first five lines are the same.
