# %% [markdown]
# # The same press and slide with CalculiX
#
# This demo emphasizes
# - how a study becomes an input deck for another finite element code (`tactile_fem.deck`),
# - whether two codes that share nothing but the mesh find the same forces and the same strain
#   energy density (SED) at the receptors,
# - what each of them needs: iterations, seconds.
#
# Same nodes and tetrahedra, same energies, same held nodes, same increments, no viscosity. What
# differs is the contact: here Nitsche's method against the stimulator's smooth distance, there
#
# $$p = k\,[-g]_+,\qquad |t_t| \le \mu p,$$
#
# a linear penalty, integrated over the overlap of skin facets with a height field of small flat
# squares. The skin then sinks into the stimulator by $p/k$, a micrometre or less.
#
# CalculiX prints the SED at the four integration points of a tetrahedron, whose mean we take here
# as well; a receptor reads the mean of the tetrahedra in the epidermis within 0.25 mm of it, each
# weighted by its share of that ball. CalculiX sums the SED up over the increments, $\sum \tfrac12
# (S_n + S_{n-1}) : (E_n - E_{n-1})$, here it is the energy $W(F)$ itself.
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
# (The pad and the last one make a mesh of their own, which needs gmsh.) `run_deck.py` tells how to
# get CalculiX. If `--timeout` ends it, what it did until then is compared.

# %%
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from cyclopts import run
from matplotlib.figure import Figure
from pad import half_ellipsoid
from run_deck import is_installed, run_deck

from tactile_fem import backend  # noqa: F401  (brings DOLFINx, before MPI)
from tactile_fem.deck import DeckSize, Penalty, write_deck
from tactile_fem.files import write_table
from tactile_fem.finger import FingerMesh, load_finger
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.march import March
from tactile_fem.mechanics.probe import CellEnergy
from tactile_fem.mechanics.problem import FingerProblem
from tactile_fem.receptors import Samples, place, sample
from tactile_fem.study import (
    AnyStimulus,
    Cylinder,
    Finger,
    Plate,
    Polynomial,
    Protocol,
    Receptors,
    Solver,
    Study,
    Text,
    Tissue,
)

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

# Both contact laws are so stiff that more changes nothing.
PENALTY = Penalty(stiffness_MPa_per_mm=15.0, stick_MPa_per_mm=1.5)


# %% [markdown]
# The cases. A height field is as coarse as the body allows: CalculiX integrates over each of its
# squares. Four points lie along the finger, the fifth is its contact point.
#
# The pad (`pad.py`) has a skin of 1 mm instead of a thin stiff layer: its facets are flatter than
# the skin is thick, and Nitsche's method wants a larger $\gamma$. Contact over 5 kPa would blur a
# light touch as well (1.3 % at 0.15 mm).


# %%
@dataclass(frozen=True)
class Case:
    """What is pressed how far; lengths in mm.

    `grid` is the spacing of the height field, `along` are the points' Y; `gamma` and
    `width_MPa` are those of our contact, the package's defaults on the finger.
    """

    stimulus: AnyStimulus
    grid: tuple[float, float]
    depth: float
    distance: float
    press_step: float
    slide_step: float
    along: tuple[float, ...]
    gamma: float = Solver().nitsche_gamma
    width_MPa: float = Solver().contact_width_MPa


NEAR, APART = (-2.0, -1.0, 1.0, 2.0), (-4.0, -2.0, 2.0, 4.0)
CASES = {
    "pad": Case(Plate(friction=0.3), (4.0, 4.0), 1.5, 1.5, 0.15, 0.1, NEAR, 4.6, 0.0005),
    "plate": Case(Plate(friction=0.3), (4.0, 4.0), 1.0, 0.2, 0.2, 0.1, NEAR),
    "cylinder": Case(Cylinder(friction=0.3), (4.0, 0.1), 0.5, 0.2, 0.1, 0.025, NEAR),
    "letters": Case(Text(friction=0.3), (0.1, 0.1), 0.6, 0.2, 0.2, 0.025, APART),
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
    timeout: float = 3600.0,
) -> None:
    """Press and slide with both codes and compare them; lengths in mm, times in s.

    CalculiX takes as many threads as there are MPI ranks.
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
        study, mesh = study_of(the_case, finger, elastic), load_finger(finger)
    receptors = place(study.receptors, mesh)
    samples = sample(study.receptors, receptors, mesh)
    deck, size = folder / "calculix" / "deck.inp", None
    if comm.rank == 0:
        deck.parent.mkdir(parents=True, exist_ok=True)
        cells = np.unique(samples.cell)
        size = write_deck(
            study, mesh, deck, grid_mm=the_case.grid, penalty=PENALTY, energy_of=cells
        )
    size = comm.bcast(size)
    our_cost, our_way = ours(study, mesh, samples, size)
    if comm.rank:
        return
    their_cost, their_way = theirs(study, deck, samples, size, timeout)
    tell_cost(our_cost, their_cost)
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
            nitsche_gamma=case.gamma,
            contact_width_MPa=case.width_MPa,
            first_step_mm=case.press_step,
            max_press_step_mm=case.press_step,
            first_slide_step_mm=case.slide_step,
            max_slide_step_mm=case.slide_step,
        ),
    )


# %% [markdown]
# What a code did, and what that took. The way counts the indentation first, then the slide.


# %%
@dataclass(frozen=True)
class Cost:
    """What a code needed.

    `seconds` is wall time without start-up; `cpu_seconds` hardly changes when the computer has
    other work too.
    """

    code: str
    tetrahedra: int
    unknowns: int
    cores: int
    finished: bool
    steps: int
    iterations: int
    seconds: float
    cpu_seconds: float

    @property
    def seconds_per_iteration(self) -> float:
        """Wall time of an iteration."""
        return self.seconds / max(self.iterations, 1)


@dataclass(frozen=True)
class Way:
    """What happened on the way: (n,) mm, (n, 3) N on the finger, (n, points) kPa."""

    way_mm: np.ndarray
    force_N: np.ndarray
    sed_kPa: np.ndarray

    def at(self, way_mm: np.ndarray) -> "Way":
        """Return this way at other places, linearly between its steps."""
        force, sed = (
            np.column_stack([np.interp(way_mm, self.way_mm, c) for c in field.T])
            for field in (self.force_N, self.sed_kPa)
        )
        return Way(way_mm, force, sed)


def read_at(samples: Samples, energy_kPa: np.ndarray) -> np.ndarray:
    """Return the receptors' readings of a field that is constant in each tetrahedron."""
    return np.bincount(samples.receptor, samples.weight * energy_kPa[samples.cell])


def ours(study: Study, finger: FingerMesh, samples: Samples, size: DeckSize) -> tuple[Cost, Way]:
    """March through the protocol; the seconds are those of the steps, without compiling."""
    comm = MPI.COMM_WORLD
    domain = create_domain(finger, comm, study.solver.held)
    problem = FingerProblem.of(study, domain)
    energy = CellEnergy(problem)
    cpu = time.process_time()
    steps, sed = [], []
    for step in March(problem, study.protocol, study.solver, study.protocol.depth_mm):
        steps.append(step)
        sed.append(read_at(samples, energy.gather()))
    cpu = comm.allreduce(time.process_time() - cpu)
    iterations = sum(step.newton_iterations for step in steps)
    seconds = sum(step.wall_s for step in steps)
    work = comm.size, True, len(steps), iterations, seconds, cpu
    cost = Cost("tactile_fem", size.tets, size.unknowns, *work)
    way = [step.depth_mm + max(step.displacement_mm, 0.0) for step in steps]
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
    cost = Cost("CalculiX", size.tets, size.unknowns, *work)
    lengths = np.array([protocol.depth_mm, protocol.distance_mm])
    way = np.where(done.leg > 0, protocol.depth_mm, 0.0) + done.share * lengths[done.leg]
    sed = np.array([read_at(samples, cells) for cells in done.sed_kPa])
    return cost, Way(way, done.force_N, sed)


# %%
def tell_cost(mine: Cost, other: Cost) -> None:
    """Print what the codes needed, side by side."""
    for name, value in asdict(mine).items():
        pair = value, getattr(other, name)
        shown = (f"{v:.4g}" if isinstance(v, float) else str(v) for v in pair)
        print(f"{name.replace('_', ' '):24}{'  '.join(f'{text:>12}' for text in shown)}")
    ratio = other.seconds_per_iteration / mine.seconds_per_iteration
    print(f"ratio of seconds per iteration: {ratio:.1f}")
    if other.finished:
        print(f"ratio of seconds: {other.seconds / mine.seconds:.1f}")


# %% [markdown]
# The comparison, at our steps. A difference is told as a share of CalculiX's value at the same
# place; friction as a share of its value at the end, since it starts from nothing.


# %%
@dataclass(frozen=True)
class Place:
    """Forces at one place of the way; the tangential one is against the motion."""

    depth_mm: float
    slide_mm: float
    normal_N: float
    calculix_normal_N: float
    tangential_N: float
    calculix_tangential_N: float


@dataclass(frozen=True)
class Point:
    """SED at one receptor at the end of a leg."""

    moment: str
    x_mm: float
    y_mm: float
    sed_kPa: float
    calculix_sed_kPa: float


def compare(protocol: Protocol, points: np.ndarray, mine: Way, other: Way, folder: Path) -> None:
    """Print, keep and draw the differences, as far as both went; `points` as (n, 3) mm."""
    mine = mine.at(mine.way_mm[mine.way_mm < other.way_mm[-1] + 1e-9])
    other = other.at(mine.way_mm)
    depth = np.minimum(mine.way_mm, protocol.depth_mm)
    slide = mine.way_mm - depth
    normal, their_normal = mine.force_N[:, 2], other.force_N[:, 2]
    friction, their_friction = -mine.force_N[:, 1], -other.force_N[:, 1]
    table = np.column_stack([depth, slide, normal, their_normal, friction, their_friction])
    places = [Place(*row) for row in table.tolist()]
    write_table(folder / "forces.csv", places)

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
    felt = [
        Point(moment, *at[:2].tolist(), float(a), float(b))
        for moment, row in ends.items()
        for at, a, b in zip(points, mine.sed_kPa[row], other.sed_kPa[row], strict=True)
    ]
    felt.sort(key=lambda point: (point.moment, point.y_mm))
    write_table(folder / "sed.csv", felt)
    for p in felt:
        told = f"{p.moment}: SED at Y {p.y_mm:+.1f} mm {p.sed_kPa:.4f} kPa, CalculiX "
        differs = abs(p.sed_kPa / p.calculix_sed_kPa - 1)
        print(f"{told}{p.calculix_sed_kPa:.4f} kPa, differs by {differs:.2%}")
    draw(places, felt, folder / "comparison.png")


def draw(places: list[Place], felt: list[Point], picture: Path) -> None:
    """Draw forces and SED of both codes."""
    figure = Figure(figsize=(10, 3.2), layout="constrained")
    press, slide, sed = figure.subplots(1, 3)
    pressed = [p for p in places if p.slide_mm < 1e-9]
    slid = [pressed[-1], *(p for p in places if p.slide_mm >= 1e-9)]
    blue, orange = "#0072B2", "#D55E00"
    for axes, rows, x, kinds in (
        (press, pressed, "depth_mm", {"normal": blue}),
        (slide, slid, "slide_mm", {"normal": blue, "tangential": orange}),
    ):
        for kind, colour in kinds.items():
            at = [getattr(p, x) for p in rows]
            axes.plot(at, [getattr(p, f"{kind}_N") for p in rows], color=colour, label=kind)
            other = [getattr(p, f"calculix_{kind}_N") for p in rows]
            axes.plot(at, other, "o", color=colour, mfc="none", label=f"{kind}, CalculiX")
    press.set(xlabel="Indentation (mm)", ylabel="Normal force (N)")
    slide.set(xlabel="Slide (mm)", ylabel="Force (N)")
    for moment, colour in (("press", blue), ("slide", orange)):
        points = [p for p in felt if p.moment == moment]
        if points:
            y = [p.y_mm for p in points]
            label = f"end of {moment}"
            sed.plot(y, [p.sed_kPa for p in points], color=colour, label=label)
            other = [p.calculix_sed_kPa for p in points]
            sed.plot(y, other, "o", color=colour, mfc="none", label=f"{label}, CalculiX")
    sed.set(xlabel="Y along the finger (mm)", ylabel="Strain energy density (kPa)")
    for axes in (press, slide, sed):
        axes.legend(frameon=False, fontsize="small")
        axes.set_ylim(bottom=0)
    figure.savefig(picture, dpi=150)


# %%
if __name__ == "__main__":
    run(main)
