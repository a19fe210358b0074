# %% [markdown]
# # How the shares of the finger pad's relaxation were fitted
#
# The times are measured (4 ms, 70 ms, 1.4 s: Pawluk and Howe 1999). The three shares are fitted to
# the falls of a held force and to the energy lost in a tap (`relaxation.py`), with what is known
# before: shares of about a quarter each, as remembered of such series, not read anew. The falls
# tell the long share; of the short ones only the tap tells anything, and its time course is
# proposed, so it counts for little.
#
#     python demos/validation/fit_relaxation.py results/relaxation

# %%
from pathlib import Path

import numpy as np
from relaxation import FALLS, OUTPUTS, TAP_LOSS, TAP_S, fall, relaxing, tap_loss
from scipy.optimize import least_squares

from tactile_fem import run_script, write_table
from tactile_fem.study import Finger

# Standard deviations of the falls, of the tap, of each share: proposed.
FALL_SD, TAP_SD = 0.02, 0.10
BEFORE, BEFORE_SD = 0.25, 0.05
NAMES = "g of 4 ms", "g of 70 ms", "g of 1.4 s"
STEP = 0.1  # of the differences, relative


# %%
def main(
    folder: Path,
    *,
    start: tuple[float, float, float] = (0.25, 0.25, 0.15),
    evaluations: int = 3,
    pad_size: float = 3.0,
    far_size: float = 6.0,
    outputs: int = OUTPUTS,
) -> None:
    """Fit the shares.

    Parameters
    ----------
    folder
        For the table of what was tried, `fit.csv`.
    start
        Shares of the three times.
    evaluations
        How many points are tried, apart from those for derivatives.
    pad_size, far_size
        The mesh, mm. Falls and losses are ratios, for which a very coarse one will do.
    outputs
        Steps of each part of a hold, at least.
    """
    finger = Finger(pad_size_mm=pad_size, far_size_mm=far_size)
    records: list[dict[str, float]] = []

    def misfit(shares: np.ndarray) -> np.ndarray:
        tissue = relaxing(shares)
        falls = [fall(finger, tissue, *numbers, outputs) for *numbers, _ in FALLS]
        lost = tap_loss(finger, tissue, TAP_S)
        found = {f"fall of {force:g} N": x for (force, *_), x in zip(FALLS, falls, strict=True)}
        records.append({**dict(zip(NAMES, shares, strict=True)), **found, "tap's loss": lost})
        print(", ".join(f"{name} {value:.4f}" for name, value in records[-1].items()), flush=True)
        measured = np.array([share for *_, share in FALLS])
        return np.concatenate(
            [
                (falls - measured) / FALL_SD,
                [(lost - TAP_LOSS) / TAP_SD],
                (shares - BEFORE) / BEFORE_SD,
            ]
        )

    fit = least_squares(misfit, start, diff_step=STEP, max_nfev=evaluations)
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "fit.csv", records)
    after = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    for name, value, sd in zip(NAMES, fit.x, after, strict=True):
        learnt = 1 - (sd / BEFORE_SD) ** 2
        print(f"{name}: {value:.3f} ± {sd:.3f}, learnt {learnt:.2f}")


if __name__ == "__main__":
    run_script(main)
