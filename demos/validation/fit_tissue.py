# %% [markdown]
# # The fit that makes the tissue set "fitted"
#
# This demo emphasizes
# - how two constants of the subcutaneous tissue are fitted to the force on a flat plate,
# - how well the measurements determine them: confidence intervals and correlation,
# - a fit that can be interrupted, because every run of the model is saved.
#
# The subcutaneous tissue has the energy
#
# $$W = C_{10}(\bar I_1-3) + C_{20}(\bar I_1-3)^2 + (J-1)^2/D_1.$$
#
# $C_{10}$ is its stiffness at small strains, $C_{20}$ its hardening. With the mean forces $m_k$ of
# four fingers and their standard deviations $s_k$ at 0.5, 1.0, 1.5 and 2.0 mm the fit minimizes
#
# $$\sum_k r_k^2, \qquad r_k = (F_k - m_k)/s_k, \qquad x = (\ln C_{10}, \ln C_{20}).$$
#
# Everything else is fixed: the layers above, and $D_1$ from $E$ = 5 kPa and $\nu$ = 0.48. (If
# Poisson's ratio were fixed instead, the bulk modulus would follow $C_{10}$ down to a few kPa, less
# than the pressure under the plate, and the pad would be compressed rather than displaced.)
# $C_{10}$ is limited to one standard deviation around the values measured on porcine fat, because
# the plate hardly determines it: below 0.5 mm the layers above carry most of the force.
#
# With $J = \partial r/\partial x$ the covariance of $x$ is $(J^T J)^{-1}$. It assumes that the four
# deviations are independent. They are not, because they come from the same fingers, so the
# intervals are only a guide.
#
#     python demos/validation/fit_tissue.py results/fit
#     python demos/validation/fit_tissue.py results/fit_1MPa --corneum 1.0

# %%
import csv
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from flat_plate import DEPTH_MM, DEVIATION_N, MEAN_N, plate_study
from scipy.optimize import OptimizeResult, least_squares

from tactile_fem.cli.entry import run
from tactile_fem.runtime.files import write_table
from tactile_fem.scan import scan

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

# C10 and C20, MPa. C10 is half the shear modulus, and that of porcine fat is 0.53 (sd 0.31) kPa
# (Sims et al. 2010, DOI 10.1007/s10237-010-0207-9); C20 is free.
LEAST, LARGEST = (1.1e-4, 1e-5), (4.2e-4, 1e-1)
# Far above what the solver's tolerance blurs, and the forces are still nearly straight over it.
LOG_STEP = 0.06
NU_CORNEUM = 0.48


@dataclass(frozen=True)
class Run:
    """One press of the plate; forces in N."""

    C10_MPa: float
    C20_MPa: float
    force_05mm_N: float
    force_10mm_N: float
    force_15mm_N: float
    force_20mm_N: float

    @property
    def forces_N(self) -> np.ndarray:
        """Forces at the four measured depths, (4,)."""
        return np.array([getattr(self, field.name) for field in fields(self)[2:]])


# %%
def main(
    folder: Path,
    *,
    start: tuple[float, float] = (1.3e-4, 9e-4),
    corneum: float = 0.5,
    d1: float = 48.0,
    step: float = 0.25,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    evaluations: int = 12,
) -> None:
    """Fit C10 and C20 (MPa) of the subcutaneous tissue to the flat plate's force.

    Parameters
    ----------
    folder
        Keeps the runs; a second start with the same options repeats none.
    start
        First C10 and C20, MPa.
    corneum
        Young's modulus of the stratum corneum, MPa.
    d1
        D1 of the subcutaneous tissue, 1/MPa.
    step
        Length of the plate's steps, mm; a divisor of 0.5.
    preset
        Size of the mesh.
    evaluations
        Most evaluations of the fit, each of up to three runs.
    """
    if MPI.COMM_WORLD.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
    fixed = {
        "stratum_corneum": {
            "C10_MPa": corneum / (4 * (1 + NU_CORNEUM)),
            "D1_per_MPa": 6 * (1 - 2 * NU_CORNEUM) / corneum,
        }
    }
    first = np.log(np.array(start) * 1e6)
    runs = Runs(folder / "runs.csv", lambda c10, c20: press(c10, c20, d1, fixed, step, preset))
    fit = least_squares(
        lambda x: (runs(*np.exp(x) * 1e-6).forces_N - MEAN_N) / DEVIATION_N,
        first,
        bounds=tuple(np.log(np.array(limits) * 1e6) for limits in (LEAST, LARGEST)),
        diff_step=LOG_STEP / first,  # relative to the logarithms, of Pa
        xtol=1e-2,
        ftol=1e-3,
        max_nfev=evaluations,
    )
    if MPI.COMM_WORLD.rank == 0:
        print_results(fit, runs(*np.exp(fit.x) * 1e-6).forces_N, len(runs))


# %% [markdown]
# Every run is saved before the next one starts.


# %%
class Runs:
    """The model as a function of C10 and C20 (MPa), which computes each run only once.

    Parameters
    ----------
    path
        CSV file of the runs.
    model
        Returns the forces (4,) in N.
    """

    def __init__(self, path: Path, model: Callable[[float, float], np.ndarray]) -> None:
        self._path, self._model = path, model
        self._runs: dict[tuple[float, float], Run] = {}
        rows = (
            csv.DictReader(path.read_text(encoding="utf-8").splitlines()) if path.exists() else ()
        )
        for row in rows:
            known = Run(**{name: float(value) for name, value in row.items()})
            self._runs[known.C10_MPa, known.C20_MPa] = known

    def __len__(self) -> int:
        return len(self._runs)

    def __call__(self, c10: float, c20: float) -> Run:
        """Return the run with these constants, to five digits."""
        key = float(f"{c10:.4e}"), float(f"{c20:.4e}")
        if key not in self._runs:
            self._runs[key] = Run(*key, *(round(float(f), 6) for f in self._model(*key)))
            if MPI.COMM_WORLD.rank == 0:
                write_table(self._path, list(self._runs.values()))
                deviation = (self._runs[key].forces_N - MEAN_N) / DEVIATION_N
                print(
                    f"C10 {key[0]:.4e}  C20 {key[1]:.4e}  deviation in sd",
                    *deviation.round(3),
                    flush=True,
                )
        return self._runs[key]


def press(
    c10: float, c20: float, d1: float, fixed: dict[str, Any], step: float, preset: str
) -> np.ndarray:
    """Return the plate's forces (4,) in N at the measured depths."""
    subcutaneous = {"C10_MPa": c10, "C20_MPa": c20, "D1_per_MPa": d1}
    tissue = {**fixed, "subcutaneous": subcutaneous}
    trace = scan(plate_study(float(DEPTH_MM[-1]), step, tissue, preset)).trace
    return np.interp(DEPTH_MM, trace.depth_mm, trace.force_N[:, 2])


# %% [markdown]
# The constants with their confidence intervals and correlation.


# %%
def print_results(fit: OptimizeResult, forces: np.ndarray, count: int) -> None:
    """Print constants, intervals, correlation and residuals."""
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    deviation = np.sqrt(np.diag(covariance))
    values, factors = np.exp(fit.x) * 1e-6, np.exp(1.96 * deviation)
    limited = np.where(fit.active_mask, ", at its limit", "")
    for name, value, factor, limit in zip(("C10", "C20"), values, factors, limited, strict=True):
        interval = f"95 % from {value / factor:.2e} to {value * factor:.2e}"
        print(f"{name} {value:.4e} MPa, {interval}{limit}")
    print(f"correlation of ln C10 and ln C20 {covariance[0, 1] / deviation.prod():+.3f}")
    print("depth mm  model N  measured N (sd)  error/sd")
    for at, force, mean, sd, deviation in zip(
        DEPTH_MM, forces, MEAN_N, DEVIATION_N, fit.fun, strict=True
    ):
        print(f"{at:8.1f}  {force:7.4f}  {mean:.3f} ({sd:.3f})  {deviation:+8.2f}")
    print(f"sum of squares {2 * fit.cost:.3f}, two degrees of freedom")
    print(f"{count} runs: {fit.message}")


# %%
if __name__ == "__main__":
    run(main)
