# %% [markdown]
# # Convergence of the receptors' strain energy density with mesh and step size
#
# The same letters are scanned on each mesh. With $S_h(s, r)$ the strain energy density (SED) of
# receptor $r$ at the slide $s$ and $S$ that of the finest mesh, the table shows
#
# $$ e_{max} = \operatorname{rms}_r \frac{\max_s S_h - \max_s S}{\max_s S}, \qquad
#    e = \frac{\lVert S_h - S \rVert}{\lVert S \rVert}, $$
#
# the first over the receptors whose maximum exceeds a fifth of the largest one. With
# $e \propto h^p - h_f^p$ and $h \propto \text{unknowns}^{-1/3}$ three meshes give the order $p$
# and the error of the finest mesh. Halved steps are compared with the first mesh's own.
#
#     python demos/verification/convergence.py results/convergence --distance 4
#     mpirun -n 2 python demos/verification/convergence.py results/convergence
#
# Complete scans in the folder are not repeated; interrupted ones continue.

# %%
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from tactile_fem import Results, Study, completed, run_script, write_table
from tactile_fem.study import Finger, Output, Protocol, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

STEPS = ("first_step_mm", "max_press_step_mm", "first_slide_step_mm", "max_slide_step_mm")


@dataclass(frozen=True)
class Error:
    """Deviation of one scan's SED from its reference, as shares."""

    mesh: str
    reference: str
    unknowns: int
    steps: int
    newton: int
    force_N: float
    maxima_rms: float
    maxima_worst: float
    history: float


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
        Folder for scans and table.
    meshes
        Presets, or pairs of element edges "pad,far" in mm, from coarse to fine; default all three
        presets, of which `paper` takes more than half an hour.
    depth, distance
        Depth of the press and length of the slide, in mm.
    """
    meshes = meshes or ["coarse", "medium", "paper"]
    studies = {name: study_of(name, depth, distance) for name in meshes}
    half = f"{meshes[0]}, half the step"
    studies[half] = halved(studies[meshes[0]])
    scans = {
        name: completed(study, folder / name.replace(", ", "-").replace(" ", "-"))
        for name, study in studies.items()
    }
    if MPI.COMM_WORLD.rank:
        return
    pairs = [(name, meshes[-1]) for name in meshes[:-1]] + [(half, meshes[0])]
    errors = [error_of(scans, *pair) for pair in pairs]
    write_table(folder / "errors.csv", errors)
    for e in errors:
        print(
            f"{e.mesh} against {e.reference}: {e.unknowns} unknowns, {e.steps} steps, {e.newton} "
            f"Newton iterations, {e.force_N:.4f} N; maxima {e.maxima_rms:.1%}, at most "
            f"{e.maxima_worst:.1%}, histories {e.history:.1%}"
        )
    if len(meshes) > 2:
        unknowns = [scans[name].run["mesh"]["unknowns"] for name in meshes[-3:]]
        print(order(np.array(unknowns), [error.history for error in errors[-3:-1]]))


def study_of(mesh: str, depth: float, distance: float) -> Study:
    """Return the scan on a preset's mesh or on one of a pair of element edges."""
    if "," in mesh:
        pad, far = map(float, mesh.split(","))
        finger = Finger(preset="medium", pad_size_mm=pad, far_size_mm=far, epidermis_rows=1)
    else:
        finger = Finger(preset=mesh)
    protocol = Protocol(depth_mm=depth, distance_mm=distance, output_mm=min(0.1, distance))
    return Study(finger=finger, protocol=protocol, output=Output(pictures=False))


def halved(study: Study) -> Study:
    """Return the study with half the steps, which output positions bound as well."""
    steps = {name: getattr(study.solver, name) / 2 for name in STEPS}
    steps["max_slide_step_mm"] = study.protocol.output_mm / 2
    return study.model_copy(update={"solver": Solver(**steps)})


# %%
def histories(results: Results) -> np.ndarray:
    """Return the SED (positions, receptors), kPa, at the output positions, which all scans have."""
    trace, protocol = results.trace, results.study.protocol
    slide = trace["displacement_mm"]
    count = round(protocol.distance_mm / protocol.output_mm)
    positions = protocol.output_mm * np.arange(1, count + 1)
    rows = [np.flatnonzero(slide == 0)[-1], *(np.abs(slide - at).argmin() for at in positions)]
    return trace["sed_kPa"][rows]


def error_of(scans: dict[str, Results], name: str, reference: str) -> Error:
    """Return the deviation of one scan from another."""
    results = scans[name]
    sed, true = histories(results), histories(scans[reference])
    peak, true_peak = sed.max(axis=0), true.max(axis=0)
    felt = true_peak > 0.2 * true_peak.max()
    error = peak[felt] / true_peak[felt] - 1
    trace = results.trace
    return Error(
        name,
        reference,
        results.run["mesh"]["unknowns"],
        len(trace["time_s"]) - 1,
        int(trace["newton_iterations"].sum()),
        float(trace["force_N"][-1, 2]),
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(error).max()),
        float(np.linalg.norm(sed - true) / np.linalg.norm(true)),
    )


def order(unknowns: np.ndarray, errors: list[float]) -> str:
    """Return the observed order and the finest mesh's own error, in words."""
    h = (unknowns / unknowns[-1]) ** (-1 / 3)

    def mismatch(p: float) -> float:
        return (h[0] ** p - 1) / (h[1] ** p - 1) - errors[0] / errors[1]

    low, high = 0.05, 6.0
    if mismatch(low) * mismatch(high) > 0:
        return "The three meshes are not in the range of a power law: no order, no estimate."
    p = brentq(mismatch, low, high)
    finest = errors[1] / (h[1] ** p - 1)
    return f"order of the histories {p:.2f}; error of the finest mesh itself {finest:.1%}"


# %%
if __name__ == "__main__":
    run_script(main)
