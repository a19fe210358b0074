# %% [markdown]
# # A ring is drawn in circles over a finger with a fat of its own
#
# This demo emphasizes
# - that an own tissue law, stimulus, piece of the path, drive, transduction, term of the virtual
#   work, observer and solver are one short file each, without a change to the package,
# - that they go through a scan with everything else as usual: restart, results folder, pictures,
# - how a script steps by hand and looks at anything between two steps.
#
# `fung.py` is a law, `ring.py` a stimulus, `circle.py` a piece of the path, `shear.py` a drive with
# a field of its own, `changes.py` a transduction, `gravity.py` a term, `skin_height.py` an observer
# and `compared.py` a solver; [Extending](../pages/extending.md) explains them.
#
# If it is killed, the same command continues from the last step, on any number of ranks.
#
#     python demos/own_parts/scan.py results/own_parts
#     mpirun -n 2 python demos/own_parts/scan.py results/own_parts

# %%
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from changes import Changes
from circle import Circle
from compared import Compared
from fung import Fung
from gravity import Gravity
from ring import Ring
from shear import SHEAR
from skin_height import SkinHeight

from tactile_fem import Parts, Population, Results, Simulation, Study, draw, run_script, scan
from tactile_fem.simulation.run import ScanResult
from tactile_fem.study import Finger, Hold, Lift, Output, Press, Protocol, Receptors

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)


# %% [markdown]
# ## An observer may be a function
#
# It is called on all ranks after each accepted step; what it returns becomes columns of
# `trace.npz`. The centre of pressure follows from force and moment.


# %%
def centre_of_pressure(seen):
    """Return X and Y, mm, where the normal force acts at the depth of the body's top."""
    force, moment, z = seen.step.force_N, seen.step.moment_Nmm, seen.step.depth_mm
    normal = max(force[2], 1e-9)
    x, y = (z * force[0] - moment[1]) / normal, (z * force[1] + moment[0]) / normal
    return {"centre_of_pressure_mm": [x, y]}


# %% [markdown]
# ## The scan
#
# Kinds of stimulus and path belong to the study, other parts are handed in. `scan` continues an
# unfinished scan in the folder; the restart file knows what the own parts do and refuses others.


# %%
def main(folder: Path, *, depth: float = 1.2, radius: float = 1.5, speed: float = 20.0) -> None:
    """Press the ring, draw a circle, lift it off; print what was felt."""
    press = Press(depth_mm=depth, speed_mm_s=speed)
    circle = Circle(radius_mm=radius, speed_mm_s=speed)
    hold, lift = Hold(time_s=0.05, output_s=0.01), Lift(speed_mm_s=speed)
    study = Study(
        finger=Finger(pad_size_mm=3.0, far_size_mm=6.0),
        stimulus=Ring(radius_mm=2.0),
        protocol=Protocol(path=(press, hold, circle, lift)),
        receptors=Receptors(half_width_mm=4.0, spacing_mm=0.5),
        output=Output(states_mm=1.0),
    )
    parts = Parts(
        laws={"subcutaneous": Fung(shear=0.8e-3, bulk=0.02, b=2.0)},
        terms=(Gravity,),
        populations=(Population(feels=SHEAR, transduction=Changes(gain=500.0)),),
    )
    observers = centre_of_pressure, SkinHeight(study.finger.mesh(), [(0.0, 0.0)])
    result = scan(study, folder, observers=observers, parts=parts)
    weightless, difference_mm = pressed(study, replace(parts, terms=(partial(Gravity, g_mm_s2=0),)))
    if MPI.COMM_WORLD.rank == 0:
        print_results(result, weightless, difference_mm)
        for file in draw(folder):
            print(file)


# %% [markdown]
# ## Stepping by hand
#
# The same press once more, without weight and with the solver that compares.


# %%
def pressed(study: Study, parts: Parts) -> tuple[float, float]:
    """Return the force at the end of the press, N, and the solvers' largest difference, mm."""
    with closing(Simulation(study, parts, make_solver=Compared)) as simulation:
        step = next(step for step in simulation.steps() if step.ends_piece)
        return step.force_N[2], simulation.problem.solver.difference_mm


# %%
def print_results(result: ScanResult, weightless_N: float, difference_mm: float) -> None:
    """Print a number for each of the parts."""
    trace = Results.open(result.folder).trace
    pressed, circle = (trace["phase"] == phase for phase in ("press", "circle"))
    depth_mm, force_N = trace["depth_mm"][pressed][-1], trace["force_N"][pressed, 2][-1]
    area_mm2 = trace["contact_area_mm2"][pressed][-1]
    way_mm, shear = trace["displacement_mm"][circle][-1], np.abs(trace["shear_strain_yz"]).max()
    imbalance_N, weight_N = trace["imbalance_N"].max(), force_N - weightless_N
    bulge_mm = depth_mm - trace["skin_height_mm"][pressed][-1, 0]
    x, y = trace["centre_of_pressure_mm"][circle][-1]
    print(f"law: normal force {force_N:.4f} N at {depth_mm:.2f} mm")
    print(f"stimulus: it touches {area_mm2:.2f} mm² of skin")
    print(f"path: the circle is {way_mm:.3f} mm long")
    print(f"drive: largest shear {shear:.4f}")
    print(f"transduction: {sum(map(len, result.response.spikes))} spikes")
    print(f"term: weight adds {weight_N:.5f} N; forces balance to {imbalance_N:.0e} N")
    print(f"observers: skin bulges {bulge_mm:.3f} mm into the ring, pressure at {x:.2f} {y:.2f} mm")
    print(f"solver: displacements of both differ by at most {difference_mm:.0e} mm")


# %%
if __name__ == "__main__":
    run_script(main)
