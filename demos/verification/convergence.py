# %% [markdown]
# # Convergence of the receptors' strain energy density with mesh and step size
#
# This demo emphasizes
# - the error of the strain energy density (SED) at the receptors on three meshes, with two step
#   sizes,
# - an estimate of the finest mesh's own error,
# - how much the SED varies around a receptor, and the effect of averaging over a ball.
#
# The same letters are scanned on each mesh. With $S_h(s, r)$ the SED of receptor $r$ at the slide
# $s$ and $S$ that of the finest mesh, the table shows
#
# $$ e_{max} = \operatorname{rms}_r \frac{\max_s S_h - \max_s S}{\max_s S}, \qquad
#    e = \frac{\lVert S_h - S \rVert}{\lVert S \rVert}, $$
#
# the first over the receptors whose maximum exceeds a fifth of the largest one. With
# $e \propto h^p - h_f^p$ and $h \propto \text{unknowns}^{-1/3}$ three meshes give the order $p$
# and the error of the finest mesh. Halved steps are compared with the first mesh's own.
#
#     python demos/verification/convergence.py results/convergence
#     mpirun -n 2 python demos/verification/convergence.py results/convergence
#     python demos/verification/convergence.py results/quick --meshes 3.0,6.0 --meshes 2.2,5.0
#
# Complete scans in the folder are not repeated; interrupted ones continue.

# %%
from dataclasses import dataclass, replace
from pathlib import Path

import meshio
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

from tactile_fem import Results, Simulation, Study, completed, run_script, write_table
from tactile_fem.output.histories import central_receptor
from tactile_fem.receptors import place, sample
from tactile_fem.runtime.ranks import on_root
from tactile_fem.simulation.fields import read_series
from tactile_fem.simulation.probe import Probe
from tactile_fem.study import Finger, Output, Protocol, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

COMM = MPI.COMM_WORLD
_HALVED = ("first_step_mm", "max_press_step_mm", "first_slide_step_mm", "max_slide_step_mm")


@dataclass(frozen=True)
class Error:
    """Deviation of one scan from its reference; lengths in mm, SED in kPa."""

    mesh: str
    reference: str
    tetrahedra: int
    unknowns: int
    steps: int
    force_N: float
    central_maximum_kPa: float
    maxima_rms: float
    maxima_worst: float
    history: float


@dataclass(frozen=True)
class Spread:
    """How the SED varies within the ball of a receptor, as shares of its mean."""

    mesh: str
    slide_mm: float
    receptors: int
    sed_spread: float
    point_against_mean: float


# %%
def main(
    folder: Path,
    *,
    meshes: list[str] | None = None,
    depth: float = 1.97,
    distance: float = 10.0,
) -> None:
    """Scan on all meshes, and on the first one with halved steps; compare.

    Parameters
    ----------
    folder
        Where scans, tables and figure go.
    meshes
        Presets, or pairs of element edges "pad,far" in mm, from coarse to fine; default all three
        presets, of which `paper` takes more than half an hour.
    depth, distance
        Of the press and of the slide, in mm.
    """
    meshes = meshes or ["coarse", "medium", "paper"]
    studies = {name: study_of(name, depth, distance) for name in meshes}
    studies[f"{meshes[0]}, half the step"] = halved(studies[meshes[0]])
    scans = {
        name: completed(study, folder / name.replace(", ", "-").replace(" ", "-"))
        for name, study in studies.items()
    }
    errors = [error_of(scans, name, meshes[-1]) for name in meshes[:-1]]
    errors += [error_of(scans, name, meshes[0]) for name in scans if name not in meshes]
    spreads = [spread_of(name, scans[name]) for name in meshes]
    if COMM.rank == 0:
        print_results(errors, spreads)
        print_order(scans, meshes, [error.history for error in errors])
        write_table(folder / "errors.csv", errors)
        write_table(folder / "spread.csv", spreads)
        draw(scans, meshes, folder / "convergence.png")


def study_of(mesh: str, depth: float, distance: float) -> Study:
    """Return the scan on a preset's mesh or on one of a pair of element edges."""
    finger = Finger(preset=mesh) if "," not in mesh else None
    if finger is None:
        pad, far = map(float, mesh.split(","))
        finger = Finger(preset="medium", pad_size_mm=pad, far_size_mm=far, epidermis_rows=1)
    return Study(
        finger=finger,
        protocol=Protocol(depth_mm=depth, distance_mm=distance, output_mm=min(0.1, distance)),
        output=Output(states_mm=min(1.0, distance), pictures=False),
    )


def halved(study: Study) -> Study:
    """Return the study with half the steps."""
    steps = {name: getattr(study.solver, name) / 2 for name in _HALVED}
    # Output positions bound the step as well.
    steps["max_slide_step_mm"] = study.protocol.output_mm / 2
    return study.model_copy(update={"solver": Solver(**steps)})


# %% [markdown]
# Histories are compared where all scans have a row: at the output positions of the slide.


# %%
def histories(results: Results) -> np.ndarray:
    """Return the SED (positions, receptors) in kPa at the output positions."""
    trace, protocol = results.trace, results.study.protocol
    slide = trace["displacement_mm"]
    rows = [np.flatnonzero(slide == 0)[-1]]
    count = round(protocol.distance_mm / protocol.output_mm)
    for position in protocol.output_mm * np.arange(1, count + 1):
        rows.append(int(np.argmin(np.abs(slide - position))))
    return trace["sed_kPa"][rows]


def error_of(scans: dict[str, Results], name: str, reference: str) -> Error:
    """Return the deviation of one scan from another."""
    results = scans[name]
    sed, true = histories(results), histories(scans[reference])
    peak, true_peak = sed.max(axis=0), true.max(axis=0)
    felt = true_peak > 0.2 * true_peak.max()
    error = (peak - true_peak)[felt] / true_peak[felt]
    trace, mesh = results.trace, results.run["mesh"]
    return Error(
        name,
        reference,
        mesh["tetrahedra"],
        mesh["unknowns"],
        len(trace["time_s"]) - 1,
        float(trace["force_N"][-1, 2]),
        float(peak[central_receptor(trace["receptors_mm"])]),
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(error).max()),
        float(np.linalg.norm(sed - true) / np.linalg.norm(true)),
    )


def print_order(scans: dict[str, Results], meshes: list[str], errors: list[float]) -> None:
    """Print the observed order and the finest mesh's own error, from three meshes."""
    if len(meshes) < 3:
        return
    unknowns = np.array([scans[name].run["mesh"]["unknowns"] for name in meshes[-3:]])
    h = (unknowns / unknowns[-1]) ** (-1 / 3)
    first, second = errors[len(meshes) - 3 : len(meshes) - 1]

    def mismatch(p: float) -> float:
        return (h[0] ** p - 1) / (h[1] ** p - 1) - first / second

    low, high = 0.05, 6.0
    if mismatch(low) * mismatch(high) > 0:
        print("The three meshes are not in the range of a power law: no order, no estimate.")
        return
    order = brentq(mismatch, low, high)
    finest = second / (h[1] ** order - 1)
    print(f"order of the SED histories {order:.2f}; error of {meshes[-1]} itself {finest:.1%}")


# %% [markdown]
# The state of the slide with the largest sum of SED over the receptors is taken from the field
# files, and the SED is evaluated at every point of each receptor's ball.


# %%
def spread_of(name: str, results: Results) -> Spread:
    """Return how the SED varies around the receptors."""
    study = results.study
    finger = on_root(COMM, lambda: study.finger.mesh())
    times, files = read_series(results.fields)
    trace = results.trace
    felt = [np.interp(time, trace["time_s"], trace["sed_kPa"].sum(axis=1)) for time in times]
    strongest = int(np.argmax(felt))
    u = on_root(COMM, lambda: meshio.read(files[strongest]).point_data["displacement_mm"])
    problem = Simulation(study).problem
    problem.order.scatter(u.astype(float), problem.u)

    positions = place(study.receptors, finger)
    ball = sample(study.receptors, positions, finger)
    number, one = np.arange(len(ball.receptor)), np.ones(len(ball.receptor))
    single = replace(ball, receptor=number, weight=one)
    sed = Probe(problem, single, len(ball.receptor)).read().sed_kPa
    at_point = study.receptors.model_copy(update={"average_radius_mm": 0.0})
    points = sample(at_point, positions, finger)
    value = Probe(problem, points, len(positions)).read().sed_kPa
    groups = [sed[ball.receptor == number] for number in range(len(positions))]
    mean = np.array([group.mean() for group in groups])
    deviation = np.array([group.std() for group in groups])
    strong = mean > 0.2 * mean.max()
    return Spread(
        name,
        float(np.interp(times[strongest], trace["time_s"], trace["displacement_mm"])),
        int(strong.sum()),
        float(np.mean(deviation[strong] / mean[strong])),
        float(np.sqrt(np.mean((value[strong] / mean[strong] - 1) ** 2))),
    )


# %%
def print_results(errors: list[Error], spreads: list[Spread]) -> None:
    """Print both tables."""
    print(
        "                     against   unknowns steps force N  central  maxima rms worst  history"
    )
    for e in errors:
        values = f"{e.unknowns}", f"{e.steps}", f"{e.force_N:.4f}", f"{e.central_maximum_kPa:.3f}"
        shares = (f"{share:.1%}" for share in (e.maxima_rms, e.maxima_worst, e.history))
        row = (e.reference, *values, *shares)
        print(f"{e.mesh:>20}" + "".join(f"{value:>12}" for value in row))
    for s in spreads:
        print(
            f"{s.mesh:>20}: within a ball the SED spreads by {s.sed_spread:.1%}, point against "
            f"mean {s.point_against_mean:.1%} (at {s.slide_mm:.1f} mm, {s.receptors} receptors)"
        )


def draw(scans: dict[str, Results], meshes: list[str], picture: Path) -> None:
    """Draw the central receptor's history and the maxima across the finger."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, color in zip(meshes, ("#56B4E9", "#E69F00", "black"), strict=False):
        trace = scans[name].trace
        sed = histories(scans[name])
        slide = np.linspace(0, scans[name].study.protocol.distance_mm, len(sed))
        left.plot(slide, sed[:, central_receptor(trace["receptors_mm"])], color=color, label=name)
        x = trace["receptors_mm"][:, 0]
        order = np.argsort(x)
        right.plot(x[order], sed.max(axis=0)[order], ".-", color=color, label=name, ms=3, lw=1)
    left.set(xlabel="Slide (mm)", ylabel="SED at the central receptor (kPa)")
    right.set(xlabel="Receptor across the finger, X (mm)", ylabel="Largest SED (kPa)")
    left.legend(frameon=False)
    figure.savefig(picture, dpi=150)


# %%
if __name__ == "__main__":
    run_script(main)
