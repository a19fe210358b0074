# %% [markdown]
# # A finger reads a word in Braille
#
# This demo emphasizes
# - how a word in Braille is stroked (`stimulus.kind = "braille"`),
# - a force that is held while dots come and go,
# - what is left of the dots in the spikes of a population.
#
# The finger presses with a light force, as readers of Braille do, and slides over the word at
# 20 mm/s. A dot is 1.6 mm wide and 0.5 mm high, so it pushes the skin in like a small letter.
#
#     python demos/surfaces/braille_word.py results/braille
#     mpirun -n 2 python demos/surfaces/braille_word.py results/braille
#     python demos/surfaces/braille_word.py results/short --word t --distance 1

# %%
from pathlib import Path

import numpy as np

from tactile_fem import Results, Study, draw, run_script, scan
from tactile_fem.study import Braille, Finger, Protocol, Receptors

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

CELL_MM = Braille().cell_spacing_mm
AHEAD_MM = 4.0  # of the contact point, where the first cell begins


# %% [markdown]
# ## The scan
#
# `start_mm` is the place in the word over the contact point when the slide begins: 4 mm before the
# middle of the first cell.


# %%
def main(
    folder: Path,
    *,
    word: str = "touch",
    force: float = 0.3,
    distance: float | None = None,
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Stroke a word with a held force, N, over a distance in mm; all of it by default."""
    comm = MPI.COMM_WORLD
    whole = CELL_MM * (len(word) - 1) + 2 * AHEAD_MM
    study = Study(
        finger=Finger(pad_size_mm=pad_size, far_size_mm=far_size),
        stimulus=Braille(text=word, start_mm=-AHEAD_MM),
        protocol=Protocol(
            force_N=force, hold="force", distance_mm=distance or whole, output_mm=0.2
        ),
        receptors=Receptors(half_width_mm=4.0, spacing_mm=0.2),
    )
    result = scan(study, folder)
    if comm.rank == 0:
        tell(word, result)
        for figure in draw(folder):
            print(figure)


# %% [markdown]
# ## What was felt
#
# Spikes of all receptors while a cell passes, and how they are spread across the finger: a dot on
# the left and one on the right of a cell are 2.5 mm apart.


# %%
def tell(word: str, result) -> None:
    """Print force and spikes of each letter."""
    trace = Results.open(result.folder).trace
    slide = trace["time_s"] >= 0
    force, travelled = trace["force_N"][slide], trace["displacement_mm"][slide]
    print(f"normal force {force[:, 2].min():.3f} to {force[:, 2].max():.3f} N")
    times = [np.asarray(own) for own in result.response.spikes]
    across = trace["receptors_mm"][:, 0]
    for k, letter in enumerate(word):
        first = AHEAD_MM + CELL_MM * (k - 0.5)
        if first > travelled[-1]:
            break
        at = [np.interp(own, trace["time_s"][slide], travelled) for own in times]
        counts = np.array([np.sum((place > first) & (place <= first + CELL_MM)) for place in at])
        sides = counts[across < -0.6].sum(), counts[across > 0.6].sum()
        print(f"{letter}: {counts.sum():4d} spikes, {sides[0]} left and {sides[1]} right")


if __name__ == "__main__":
    run_script(main)
