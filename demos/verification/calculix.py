# %% [markdown]
# # The same press and slide with CalculiX
#
# This demo emphasizes
# - how a study becomes an input deck for another finite element code (`tactile_fem.output.deck`),
# - whether two codes that share only the mesh find the same forces and the same strain
#   energy density (SED) at the receptors,
# - their cost: iterations, seconds.
#
# Nodes, tetrahedra, energies, fixed nodes and increments are the same, without viscosity. Only the
# contact differs: Nitsche's method with the stimulator's smooth distance here, and in CalculiX
#
# $$p = k\,[-g]_+,\qquad |t_t| \le \mu p,$$
#
# a linear penalty, integrated over the overlap of skin facets with a height field of small flat
# squares. The skin then sinks into the stimulator by $p/k$, a micrometre or less.
#
# CalculiX prints the SED at the four integration points of a tetrahedron, whose mean we take here
# as well; a receptor reads the mean of the tetrahedra in the epidermis within 0.25 mm of it, each
# weighted by its share of that ball. CalculiX sums the SED over the increments, $\sum \tfrac12
# (S_n + S_{n-1}) : (E_n - E_{n-1})$; here it is the energy $W(F)$ itself.
#
# On a curved body CalculiX's tangential force depends on the increment of the slide, as if the
# contact's geometry lagged behind: a bar of 1.585 mm radius without friction, slid on a symmetric
# block, drags it with 0.080, 0.053, 0.027 and 0.009 of the normal force at increments of 0.2, 0.1,
# 0.05 and 0.025 mm. So the letters and the bar slide in small steps.
#
#     python demos/verification/calculix.py results/pad pad
#     python demos/verification/calculix.py results/plate plate
#     python demos/verification/calculix.py results/letters letters
#     python demos/verification/calculix.py results/small plate --pad-size 2.5 --far-size 6 --rows 1
#
# (The pad and the last example need gmsh for their meshes.) `run_deck.py` explains how to
# get CalculiX. If `--timeout` stops it, the increments up to then are compared.

# %%
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pad import half_ellipsoid
from run_deck import is_installed, run_deck
from two_codes import Cost, Way, compare, print_cost

from tactile_fem import FingerMesh, Stimulus, Study, run_script, write_table
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.output.deck import DeckSize, Penalty, write_deck
from tactile_fem.receptors import Samples, place, sample
from tactile_fem.runtime import backend  # noqa: F401  (brings DOLFINx, before MPI)
from tactile_fem.simulation.cell_fields import CellFields
from tactile_fem.simulation.stepper import Stepper
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import (
    Cylinder,
    Finger,
    Plate,
    Polynomial,
    Protocol,
    Receptors,
    Solver,
    Text,
    Tissue,
)

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

# So stiff that more changes nothing where all slides.
PENALTY = Penalty(stiffness_MPa_per_mm=15.0, stick_MPa_per_mm=1.5)


# %% [markdown]
# The cases. The height field is as coarse as the body allows, because CalculiX integrates over each
# of its squares. Four points lie along the finger, the fifth is its contact point.
#
# The pad (`pad.py`) has a skin of 1 mm instead of a thin stiff layer, so Nitsche's method needs a
# larger $\gamma$. A contact width of 5 kPa would also change a light touch (by 1.3 % at 0.15 mm).


# %%
@dataclass(frozen=True)
class Case:
    """What is pressed how far; lengths in mm.

    `grid` is the spacing of the height field, `along` are the points' Y; `contact` is what our
    contact has other than the package's defaults.
    """

    stimulus: Stimulus
    grid: tuple[float, float]
    depth: float
    distance: float
    press_step: float
    slide_step: float
    along: tuple[float, ...]
    contact: dict[str, float] = field(default_factory=dict)


PAD_CONTACT = {"nitsche_gamma": 4.6, "contact_width_MPa": 0.0005}
FINE = {"contact_degree": 20}
NEAR, APART = (-2.0, -1.0, 1.0, 2.0), (-4.0, -2.0, 2.0, 4.0)
CASES = {
    "pad": Case(Plate(friction=0.3), (4.0, 4.0), 1.5, 1.5, 0.15, 0.1, NEAR, PAD_CONTACT),
    "plate": Case(Plate(friction=0.3), (4.0, 4.0), 1.0, 0.2, 0.2, 0.1, NEAR),
    "cylinder": Case(Cylinder(friction=0.3), (4.0, 0.1), 0.5, 0.2, 0.1, 0.025, NEAR),
    "letters": Case(Text(friction=0.3), (0.1, 0.1), 0.6, 0.2, 0.2, 0.0125, APART, FINE),
}
# Neo-Hookean skin of 0.136 MPa over a second-order polynomial core of 0.03 MPa.
PAD_TISSUE = Tissue.model_validate(
    {
        "viscous_time_s": 0.0,
        "epidermis": Polynomial(C10_MPa=0.02297, D1_per_MPa=1.765),
        "subcutaneous": Polynomial(C10_MPa=0.00507, C20_MPa=0.003, D1_per_MPa=8.0),
    }
)


# %%
def main(
    folder: Path,
    case: Literal["pad", "plate", "cylinder", "letters"] = "plate",
    /,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    rows: int | None = None,
    depth: float | None = None,
    distance: float | None = None,
    press_step: float | None = None,
    slide_step: float | None = None,
    stick: float = PENALTY.stick_MPa_per_mm,
    timeout: float = 3600.0,
) -> None:
    """Press and slide with both codes and compare them; lengths in mm, times in s.

    `stick` is CalculiX's shear over slip while the skin sticks, in MPa/mm. CalculiX takes as many
    threads as there are MPI ranks.
    """
    if not is_installed():
        return
    comm = MPI.COMM_WORLD
    given = dict(depth=depth, distance=distance, press_step=press_step, slide_step=slide_step)
    the_case = replace(CASES[case], **{k: v for k, v in given.items() if v is not None})
    if case == "pad":
        study, mesh = study_of(the_case, Finger(), PAD_TISSUE), half_ellipsoid(pad_size or 1.2)
    else:
        finger = Finger(
            preset=preset, pad_size_mm=pad_size, far_size_mm=far_size, epidermis_rows=rows
        )
        elastic = Tissue.model_validate({"viscous_time_s": 0.0})
        study, mesh = study_of(the_case, finger, elastic), finger.mesh()
    receptors = place(study.receptors, mesh)
    samples = sample(study.receptors, receptors, mesh)
    deck, size = folder / "calculix" / "deck.inp", None
    if comm.rank == 0:
        deck.parent.mkdir(parents=True, exist_ok=True)
        cells = np.unique(samples.cell)
        penalty = replace(PENALTY, stick_MPa_per_mm=stick)
        size = write_deck(
            study, mesh, deck, grid_mm=the_case.grid, penalty=penalty, energy_of=cells
        )
    size = comm.bcast(size)
    our_cost, our_way = ours(study, mesh, samples, size)
    if comm.rank:
        return
    their_cost, their_way = theirs(study, deck, samples, size, timeout)
    print_cost(our_cost, their_cost)
    write_table(folder / "cost.csv", [our_cost, their_cost])
    if len(their_way.way_mm):
        compare(study.protocol, receptors, our_way, their_way, folder)


def study_of(case: Case, finger: Finger, tissue: Tissue) -> Study:
    """Return the study of a case; first and longest step are the same, so neither code chooses."""
    return Study(
        finger=finger,
        tissue=tissue,
        stimulus=case.stimulus,
        protocol=Protocol(
            depth_mm=case.depth, distance_mm=case.distance, output_mm=max(case.distance, 1.0)
        ),
        receptors=Receptors(half_width_mm=0.0, extra_mm=tuple((0.0, y) for y in case.along)),
        solver=Solver(
            **case.contact,
            locking_ratio=1e9,  # CalculiX, too, integrates volume change at every point
            first_step_mm=case.press_step,
            max_press_step_mm=case.press_step,
            first_slide_step_mm=case.slide_step,
            max_slide_step_mm=case.slide_step,
        ),
    )


# %%
def read_at(samples: Samples, energy_kPa: np.ndarray) -> np.ndarray:
    """Return the receptors' readings of a field that is constant in each tetrahedron."""
    return np.bincount(samples.receptor, samples.weight * energy_kPa[samples.cell])


def ours(study: Study, finger: FingerMesh, samples: Samples, size: DeckSize) -> tuple[Cost, Way]:
    """Go through the protocol; the seconds are those of the steps, without compiling."""
    comm = MPI.COMM_WORLD
    domain = create_domain(finger, comm, study.solver.held)
    stimulus = study.stimulus
    problem = FingerProblem(domain, study.tissue, stimulus.body(), stimulus.friction, study.solver)
    fields = CellFields(problem)
    cpu = time.process_time()
    steps, sed = [], []
    for step in Stepper(problem, study.protocol.route(0.0), study.solver):
        steps.append(step)
        sed.append(read_at(samples, fields.gather()["sed_kPa"]))
    cpu = comm.allreduce(time.process_time() - cpu)
    iterations = sum(step.newton_iterations for step in steps)
    seconds = sum(step.wall_s for step in steps)
    work = comm.size, True, len(steps), iterations, seconds, cpu
    cost = Cost("tactile_fem", size.cells, size.unknowns, *work)
    way = [step.depth_mm + step.displacement_mm for step in steps]
    force = np.array([step.force_N for step in steps])
    return cost, Way(np.array(way), force, np.array(sed))


# %% [markdown]
# CalculiX runs the deck, see `run_deck.py`.


# %%
def theirs(
    study: Study, deck: Path, samples: Samples, size: DeckSize, timeout: float
) -> tuple[Cost, Way]:
    """Run the deck, for at most `timeout` seconds."""
    protocol, cores = study.protocol, MPI.COMM_WORLD.size
    done = run_deck(deck, cores=cores, timeout=timeout)
    work = cores, done.finished, len(done.leg), done.iterations, done.seconds, done.cpu_seconds
    cost = Cost("CalculiX", size.cells, size.unknowns, *work)
    lengths = np.array([protocol.depth_mm, protocol.distance_mm])
    way = np.where(done.leg > 0, protocol.depth_mm, 0.0) + done.share * lengths[done.leg]
    sed = np.array([read_at(samples, cells) for cells in done.sed_kPa])
    return cost, Way(way, done.force_N, sed)


# %%
if __name__ == "__main__":
    run_script(main)
