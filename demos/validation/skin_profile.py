# %% [markdown]
# # The skin's profile under a cylinder and under a sharp edge
#
# This demo emphasizes
# - the skin's deflection next to an indenter, compared with published measurements,
# - how the deformed skin is read from a results folder (`SkinSurface`),
# - whether the mesh resolves the indenter.
#
# A bar lies across the finger and is pressed $d = 1$ mm into the pad: a cylinder of 3.17 mm
# diameter, or a wedge whose edge has a radius of 0.025 mm. The deflection is the rise of the
# skin's points on the midline, $w = u_z$, over their position $y + u_y$. Model and data are
# compared by
#
# $$R^2 = 1 - \frac{\sum_k (w_k - m_k)^2}{\sum_k (m_k - \bar m)^2}$$
#
# and the root mean square of $w_k - m_k$, $w_k$ being the mean of both sides. Data: Srinivasan's
# experiments with a cylinder as digitised by Gerling's group.
#
# For the edge only the profile is shown, because there are no measurements. Within a facet the
# skin cannot bend more sharply than a parabola, so the demo prints the size of the facets and the
# edge's radius.
#
#     python demos/validation/skin_profile.py results/cylinder
#     python demos/validation/skin_profile.py results/edge --stimulus edge --pad-size 0.5

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from flat_plate import BLUE, ORANGE
from matplotlib.figure import Figure
from scipy.spatial.distance import pdist

from tactile_fem import FingerMesh, Results, Study, run_script, scan, write_table
from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.finger.deformation import SkinSurface
from tactile_fem.runtime.estimates import r_squared
from tactile_fem.study import Edge, Finger, Output, Protocol, Receptors

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

(MEASURED,) = read_measurements([Path(__file__).parent / "measured" / "cylinder.csv"])
LATERAL_MM, DEFLECTION_MM = MEASURED.place_mm, MEASURED.mean
STIMULI = {"cylinder": MEASURED.indenter, "edge": Edge(radius_mm=0.025)}
HALF_LENGTH_MM = 8.0


@dataclass(frozen=True)
class Point:
    """One point of the midline: deformed position along the finger, and deflection."""

    place_mm: float
    deflection_mm: float


# %%
def main(
    folder: Path,
    *,
    stimulus: Literal["cylinder", "edge"] = "cylinder",
    depth: float = 1.0,
    tissue: str = "fitted",
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Press a bar into the pad and read the skin's profile; lengths in mm."""
    study = Study.model_validate(
        {
            "finger": Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size),
            "tissue": {"set": tissue},
            "stimulus": STIMULI[stimulus],
            "protocol": Protocol(depth_mm=depth, distance_mm=0.0, press_speed_mm_s=0.2),
            "receptors": Receptors(spacing_mm=5.0),
            "output": Output(pictures=False),
        }
    )
    force = scan(study, folder / "press", overwrite=True).trace.force_N[-1, 2]
    if MPI.COMM_WORLD.rank:
        return
    finger = study.finger.mesh()
    profile = midline(finger, Results.open(folder / "press").load_checkpoint()["u"])
    write_table(folder / f"{stimulus}.csv", [Point(*row) for row in profile.T.tolist()])
    print(f"normal force {force:.4f} N, deepest point of the skin {profile[1].max():.4f} mm")
    resolution(finger, STIMULI[stimulus].radius_mm)
    measured = stimulus == "cylinder"
    if measured:
        agreement(*profile)
    draw(*profile, folder / f"{stimulus}.png", measured=measured)


def midline(finger: FingerMesh, displacement: np.ndarray) -> np.ndarray:
    """Return deformed position and deflection, (2, points), of the skin at X = 0."""
    y = np.linspace(-HALF_LENGTH_MM, HALF_LENGTH_MM, 641)
    points = SkinSurface(finger, np.column_stack([np.zeros_like(y), y]))
    moved = points.deformed_mm(displacement)
    return np.stack([moved[:, 1], moved[:, 2] - points.rest_mm[:, 2]])


# %%
def resolution(finger: FingerMesh, radius: float) -> None:
    """Print how the facets under the bar compare with its radius."""
    skin = finger.corners_of("skin")
    near = skin[np.all(np.abs(skin.mean(axis=1)[:, :2]) < 1.5, axis=1)]
    size = float(np.mean([pdist(corners).mean() for corners in near]))
    verdict = "resolved" if size <= radius else "not resolved: the mesh rounds it"
    print(f"facets under the bar {size:.2f} mm, its radius {radius:.3f} mm: {verdict}")


def agreement(place: np.ndarray, deflection: np.ndarray) -> None:
    """Print the model's deflection next to the measured one, R2 and rms."""
    sides = np.array([np.interp(sign * LATERAL_MM, place, deflection) for sign in (-1, 1)])
    model = sides.mean(axis=0)
    print("lateral mm  proximal mm  distal mm  mean mm  measured mm")
    for at, (one, other), mean, measured in zip(
        LATERAL_MM, sides.T, model, DEFLECTION_MM, strict=True
    ):
        print(f"{at:10.1f}  {one:11.3f}  {other:9.3f}  {mean:7.3f}  {measured:11.2f}")
    error = model - DEFLECTION_MM
    r2 = r_squared(model, DEFLECTION_MM)
    print(f"R2 {r2:.4f}, rms {np.sqrt(np.mean(error**2)):.4f} mm")


# %%
def draw(place: np.ndarray, deflection: np.ndarray, picture: Path, *, measured: bool) -> None:
    """Draw the profile with the bar's lowest point at 0, and the data if there are any."""
    figure = Figure(figsize=(5.5, 3.3), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(place, deflection, color=BLUE, label="model")
    if measured:
        both = np.concatenate([-LATERAL_MM[:0:-1], LATERAL_MM])
        data = np.concatenate([DEFLECTION_MM[:0:-1], DEFLECTION_MM])
        axes.plot(both, data, "o", color=ORANGE, label="measured (one side, mirrored)")
    axes.set(
        xlabel="Place along the finger from the bar, distal positive (mm)",
        ylabel="Deflection of the skin (mm)",
        xlim=(-HALF_LENGTH_MM, HALF_LENGTH_MM),
    )
    axes.invert_yaxis()
    axes.legend(frameon=False, loc="upper center")
    figure.savefig(picture, dpi=150)


# %%
if __name__ == "__main__":
    run_script(main)
