"""
The deformed finger in PyVista
==============================

PyVista shows the finger cut open, with its strain energy density (SED), and the contact pressure
on the skin, and makes a film of all states that a scan has kept.

.. figure:: /pictures/deformed_finger.png

   One half of the finger, and the contact pressure on its skin, 10 mm into the slide. The skin is
   seen from below, hence the letters are mirrored.

Expected time: 1 minute, and 3 for the scan, unless the folder is that of ``letters.py``. It needs
the extra ``pictures``.

What to change: ``at_mm``; the column of the surface, such as ``contact`` or ``stretches``;
``results.interface()`` for the epidermis-dermis interface. ``tactile-fem view FOLDER`` opens a
window with a slider, ``--save film.mp4`` writes a film with the stimulator.
"""

# sphinx_gallery_thumbnail_path = 'pictures/deformed_finger.png'

import sys
from pathlib import Path

import numpy as np
import pyvista as pv
from PIL import Image

from tactile_fem import completed, load_study

folder = Path(sys.argv[1] if sys.argv[1:] else "results/letters")
results = completed(load_study(overrides=["stimulus.text=FGH", *sys.argv[2:]]), folder)

# %%
# ``results.skin`` returns arrays at the points of the skin. Pressure times area, summed over the
# points, is the force.

skin = results.skin(at_mm=results.trace["displacement_mm"][-1])
force_N = np.sum(skin.contact_pressure_kPa * skin.area_mm2) / 1000
print(f"{len(skin)} points of the skin, {(skin.contact > 0).sum()} of them in contact")
print(f"normal force from the pressure {force_N:.3f} N, from the scan ", end="")
print(f"{results.trace['force_N'][-1, 2]:.3f} N")

# %%
# The files in ``fields`` hold all tissues; ParaView opens their index, ``deformation.pvd``, too.

states = pv.get_reader(folder / "fields" / "deformation.pvd")
bar = {"n_labels": 2, "position_x": 0.2, "position_y": 0.03, "width": 0.6, "height": 0.13}
coloured = {"scalars": "sed_kPa", "cmap": "viridis", "log_scale": True, "clim": (0.01, 3)}
BONE, NAIL = 5, 6


def add_half(plotter: pv.Plotter, time_s: float) -> None:
    """Add one half of the deformed finger, its soft tissues coloured."""
    states.set_active_time_value(time_s)
    half = states.read()[0].clip("x", origin=(-1e-4, 0, 0)).warp_by_vector("displacement_mm")
    rigid = np.isin(half.cell_data["tissue"], (BONE, NAIL))
    soft = half.extract_cells(~rigid).cell_data_to_point_data()
    titled = {"title": "Strain energy density (kPa)", **bar}
    plotter.add_mesh(soft, name="soft", lighting=False, scalar_bar_args=titled, **coloured)
    plotter.add_mesh(half.extract_cells(rigid), color="lightgray", name="rigid", lighting=False)


def look(plotter: pv.Plotter, place: tuple, focus: tuple, upwards: tuple) -> None:
    """Look at the contact with a parallel projection."""
    plotter.camera_position = [place, focus, upwards]
    plotter.enable_parallel_projection()
    plotter.parallel_scale = 10.5


SIDE, BELOW = ((60, -12, 12), (0, 0, 4), (0, 0, 1)), ((-3, 0, -60), (-3, 0, 0), (1, 0, 0))
plotter = pv.Plotter(shape=(1, 2), off_screen=True, window_size=(1400, 600), border=False)
plotter.set_background("white")
add_half(plotter, skin.time_s)
look(plotter, *SIDE)
plotter.subplot(0, 1)
titled = {"title": "Contact pressure (kPa)", **bar}
pressed = skin.to_pyvista()
plotter.add_mesh(pressed, scalars="contact_pressure_kPa", cmap="magma_r", scalar_bar_args=titled)
look(plotter, *BELOW)
plotter.screenshot(folder / "deformed_finger.png")

# %%
# The film has one frame for each state.

film = pv.Plotter(off_screen=True, window_size=(700, 500))
film.set_background("white")
frames = []
for time_s in states.time_values:
    add_half(film, time_s)
    look(film, *SIDE)
    frames.append(Image.fromarray(film.screenshot(return_img=True)))
frames[0].save(folder / "film.gif", save_all=True, append_images=frames[1:], duration=100, loop=0)
