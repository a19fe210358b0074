# %% [markdown]
# # The same press and slide with CalculiX
#
# Nodes, tetrahedra, energies, fixed nodes and increments are the same in both codes, without
# viscosity. Only the contact differs: Nitsche's method with the stimulator's smooth distance here;
# in CalculiX a linear penalty, integrated over the overlap of skin facets with a height field of
# small flat squares. The skin then sinks into the stimulator by a micrometre or less.
#
# CalculiX prints the strain energy density (SED) at the four integration points of a tetrahedron,
# whose mean is taken here as well; a receptor reads the mean of the tetrahedra in the epidermis
# within 0.25 mm of it. On a curved body CalculiX's tangential force depends on the increment of the
# slide, so letters slide in small steps.
#
#     python demos/verification/calculix.py results/pad pad
#     python demos/verification/calculix.py results/plate plate --preset medium
#     python demos/verification/calculix.py results/letters letters
#
# (The pad needs gmsh for its mesh.) `run_deck.py` explains how to get CalculiX. If `--timeout`
# stops it, the increments up to then are compared.

# %%
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from deck import DeckSize, Penalty, write_deck
from pad import half_ellipsoid
from run_deck import is_installed, run_deck

from tactile_fem import FingerMesh, Stimulus, Study, run_script, write_table
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.receptors import Samples, place, sample
from tactile_fem.runtime import backend  # noqa: F401  (brings DOLFINx, before MPI)
from tactile_fem.simulation.cell_fields import CellFields
from tactile_fem.simulation.stepper import Stepper
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Finger, Plate, Polynomial, Protocol, Receptors, Solver, Text, Tissue

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

# So stiff that more changes nothing where all slides.
PENALTY = Penalty(stiffness_MPa_per_mm=15.0, stick_MPa_per_mm=1.5)


@dataclass(frozen=True)
class Case:
    """What is pressed how far; lengths in mm.

    `grid` is the spacing of the height field, as coarse as the body allows; `along` are the points'
    Y; `contact` is what our contact has other than the package's defaults.
    """

    stimulus: Stimulus
    grid: tuple[float, float]
    depth: float
    distance: float
    press_step: float
    slide_step: float
    along: tuple[float, ...]
    contact: dict[str, float] = field(default_factory=dict)


# The pad's thick skin needs a larger gamma, and 5 kPa would change its light touch by 1.3 %.
PAD_CONTACT = {"nitsche_gamma": 4.6, "contact_width_MPa": 0.0005}
FINE = {"contact_degree": 20}
NEAR, APART = (-2.0, -1.0, 1.0, 2.0), (-4.0, -2.0, 2.0, 4.0)
CASES = {
    "pad": Case(Plate(friction=0.3), (4.0, 4.0), 1.5, 1.5, 0.15, 0.1, NEAR, PAD_CONTACT),
    "plate": Case(Plate(friction=0.3), (4.0, 4.0), 1.0, 0.2, 0.2, 0.1, NEAR),
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
    case: Literal["pad", "plate", "letters"] = "plate",
    /,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
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
        finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
        elastic = Tissue.model_validate({"viscous_time_s": 0.0})
        study, mesh = study_of(the_case, finger, elastic), finger.mesh()
    receptors = place(study.receptors, mesh)
    samples = sample(study.receptors, receptors, mesh)
    deck, size = folder / "calculix" / "deck.inp", None
    if comm.rank == 0:
        deck.parent.mkdir(parents=True, exist_ok=True)
        penalty = replace(PENALTY, stick_MPa_per_mm=stick)
        cells = np.unique(samples.cell)
        size = write_deck(
            study, mesh, deck, grid_mm=the_case.grid, penalty=penalty, energy_of=cells
        )
    size = comm.bcast(size)
    our_cost, our_way = ours(study, mesh, samples, size)
    if comm.rank:
        return
    their_cost, their_way = theirs(study, deck, samples, size, timeout)
    for name, value in asdict(our_cost).items():
        print(f"{name:16} {value!s:>20} {getattr(their_cost, name)!s:>20}")
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
@dataclass(frozen=True)
class Cost:
    """Cost of a code; `seconds` is wall time without start-up, `cpu_seconds` that of all cores."""

    code: str
    tetrahedra: int
    unknowns: int
    finished: bool
    steps: int
    iterations: int
    seconds: float
    cpu_seconds: float


@dataclass(frozen=True)
class Way:
    """Histories of a press and slide: (n,) mm, (n, 3) N on the finger, (n, points) kPa."""

    way_mm: np.ndarray
    force_N: np.ndarray
    sed_kPa: np.ndarray

    def at(self, way_mm: np.ndarray) -> "Way":
        """Return these histories at other positions, interpolated linearly."""
        force, sed = (
            np.column_stack([np.interp(way_mm, self.way_mm, c) for c in values.T])
            for values in (self.force_N, self.sed_kPa)
        )
        return Way(way_mm, force, sed)


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
        sed.append(read_at(samples, comm.bcast(fields.gather()["sed_kPa"])))
    cpu = comm.allreduce(time.process_time() - cpu)
    iterations = sum(step.newton_iterations for step in steps)
    work = True, len(steps), iterations, sum(step.wall_s for step in steps), cpu
    way = [step.depth_mm + step.displacement_mm for step in steps]
    force = np.array([step.load.force_N for step in steps])
    cost = Cost("tactile_fem", size.cells, size.unknowns, *work)
    return cost, Way(np.array(way), force, np.array(sed))


def theirs(
    study: Study, deck: Path, samples: Samples, size: DeckSize, timeout: float
) -> tuple[Cost, Way]:
    """Run the deck, for at most `timeout` seconds."""
    protocol = study.protocol
    done = run_deck(deck, cores=MPI.COMM_WORLD.size, timeout=timeout)
    work = done.finished, len(done.leg), done.iterations, done.seconds, done.cpu_seconds
    lengths = np.array([protocol.depth_mm, protocol.distance_mm])
    way = np.where(done.leg > 0, protocol.depth_mm, 0.0) + done.share * lengths[done.leg]
    sed = np.array([read_at(samples, cells) for cells in done.sed_kPa])
    cost = Cost("CalculiX", size.cells, size.unknowns, *work)
    return cost, Way(way, done.force_N, sed)


# %%
def compare(protocol: Protocol, points: np.ndarray, mine: Way, other: Way, folder: Path) -> None:
    """Print and save the differences at our steps, as far as both codes got.

    A difference is a share of CalculiX's value at the same place; friction a share of its value at
    the end, since it starts from nothing. `points` are (n, 3) mm.
    """
    mine = mine.at(mine.way_mm[mine.way_mm < other.way_mm[-1] + 1e-9])
    other = other.at(mine.way_mm)
    depth = np.minimum(mine.way_mm, protocol.depth_mm)
    slide = mine.way_mm - depth
    normal, their_normal = mine.force_N[:, 2], other.force_N[:, 2]
    friction, their_friction = -mine.force_N[:, 1], -other.force_N[:, 1]
    columns = {
        "depth_mm": depth,
        "slide_mm": slide,
        "normal_N": normal,
        "calculix_normal_N": their_normal,
        "tangential_N": friction,
        "calculix_tangential_N": their_friction,
    }
    rows = zip(*columns.values(), strict=True)
    write_table(folder / "forces.csv", [dict(zip(columns, row, strict=True)) for row in rows])

    pressing = slide < 1e-9
    # Letters that do not touch yet leave nothing to compare.
    touching = their_normal > 0.01 * their_normal[pressing].max()
    differs = 100 * np.abs(normal / np.where(touching, their_normal, np.inf) - touching)
    print(f"press: normal force differs by at most {differs[pressing].max():.2f} %")
    print(f"press: normal force at the end differs by {differs[pressing][-1]:.2f} %")
    ends = {"press": np.count_nonzero(pressing) - 1}
    if not pressing.all():
        ends["slide"] = len(slide) - 1
        print(f"slide: normal force differs by at most {differs[~pressing].max():.2f} %")
        differs = 100 * np.abs(friction - their_friction)[~pressing] / their_friction[-1]
        print(f"slide: friction differs by at most {differs.max():.2f} %")
        print(f"slide: friction at the end differs by {differs[-1]:.2f} %")
    felt = []
    for moment, row in ends.items():
        values = points.tolist(), mine.sed_kPa[row].tolist(), other.sed_kPa[row].tolist()
        for (_, y, _), a, b in sorted(zip(*values, strict=True)):
            felt.append({"moment": moment, "y_mm": y, "sed_kPa": a, "calculix_sed_kPa": b})
            sentence = f"{moment}: SED at Y {y:+.1f} mm {a:.4f} kPa, CalculiX {b:.4f} kPa"
            print(f"{sentence}, differs by {abs(a / b - 1):.2%}")
    write_table(folder / "sed.csv", felt)


# %%
if __name__ == "__main__":
    run_script(main)
