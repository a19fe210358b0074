# %% [markdown]
# # What the fitted finger predicts
#
# This demo emphasizes
# - every measurement beside the model in one table: first those that tissues and pad were fitted
#   to, then all the others.
#
# The tissues and the pad's shape were fitted to the force on a plate and on a probe and to the
# skin's profile under a cylinder (`tactile-fem fit`). For the predictions this demo presses
#
# - the letters F G H 1.97 mm deep at two speeds: 0.6 N (Hamasaki et al. 2020), ± 15 %,
# - a plate up to 3.5 N: contact area at 0.25, 0.5 and 1 N (wide ranges, because fingers differ),
#   volume lost (at most 5 %), and the largest compressive strain in the layers of the skin
#   (Corniani et al. 2025, eLife 93554: in the stratum corneum below 10 %, in the epidermis above
#   20 % at 3.5 N, most of it reached at 0.5 N),
#
# and drags a plate across the pad (`slip.py`): tangential stiffness over the normal force (Pataky
# et al. 2005: linear), slip from the rim, and how far the skin is dragged before all of it slips
# (3.4 mm, 0.9 to 6.3, with less than 0.5 N; eLife 93554).
#
#     python demos/validation/predictions.py results/predictions
#     python demos/validation/predictions.py results/medium --preset medium

# %%
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from flat_plate import AREA_GATES, LARGEST_LOSS
from letters_force import DEPTH_MM, FORCE_N, GATE
from onset import MEASURED, up_to
from slip import Drag, full_slip, tangential_stiffness
from slip import drag as drag_plate

from tactile_fem import FingerMesh, Results, Study, run_script, scan, write_table
from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.calibration.press import press
from tactile_fem.finger.deformation import principal_strains, under_contact
from tactile_fem.runtime.estimates import r_squared
from tactile_fem.study import Finger, Plate, Protocol, Receptors, Solver, Text, Tissue

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

LEAST_R2 = 0.97
PLATE_N = (0.5, 3.5)
CENTRE_MM = 2.0  # half of the square in which strains are averaged
STIFFNESS_N = (0.25, 0.5, 1.0, 2.0)
DRAG_N, DRAG_FRICTION, DRAG_MM = 0.4, 0.8, 6.0


@dataclass(frozen=True)
class Row:
    """A prediction beside its measurement."""

    quantity: str
    measured: str
    model: str
    met: str


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    depth: float = DEPTH_MM,
    forces: tuple[float, float] = PLATE_N,
    distance: float = DRAG_MM,
    drag: float = DRAG_N,
    stiffness_forces: tuple[float, ...] = STIFFNESS_N,
    deepest: float = 3.0,
) -> None:
    """Print the table; lengths in mm, forces in N.

    Parameters
    ----------
    folder
        For the table and the plate's presses.
    preset, pad_size, far_size
        The mesh.
    depth, forces
        Of the letters, and of the plate's presses.
    drag, distance, stiffness_forces
        Normal force and length of the plate's slide, and normal forces of the stiffness.
    deepest
        Largest depth of the measurements that were fitted.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    tabulate(
        folder / "predictions.csv",
        lambda: fitted(finger, deepest),
        lambda: letters(depth, finger),
        lambda: plate(finger, folder, forces),
        lambda: sliding(finger, drag, distance, stiffness_forces),
    )


def tabulate(path: Path, *parts: Callable[[], list[Row]]) -> None:
    """Print and write the rows of each part as soon as they are known."""
    rows: list[Row] = []
    for part in parts:
        found = part()
        rows += found
        if MPI.COMM_WORLD.rank == 0:
            for row in found:
                print(f"| {row.quantity} | {row.measured} | {row.model} | {row.met} |", flush=True)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_table(path, rows)


def said(met: Any) -> str:
    """Return how a table says whether a target is met."""
    return "yes" if met else "**missed**"


# %%
def fitted(finger: Finger, deepest: float) -> list[Row]:
    """Press the indenters to which the tissues were fitted, up to a depth."""
    study = Study(finger=finger, solver=Solver(max_press_step_mm=0.25))
    rows = []
    for experiment in read_measurements(sorted(MEASURED.glob("*.csv"))):
        inside = up_to(experiment, deepest)
        if not len(inside.mean):
            continue
        values, kind = press(study, inside).values, inside.indenter.kind
        force = inside.is_force
        rows += [
            force_row(kind, *numbers)
            for numbers in zip(
                inside.depth_mm[force],
                values[force],
                inside.mean[force],
                inside.sd[force],
                strict=True,
            )
        ]
        if not force.all():
            rows.append(profile_row(kind, values[~force], inside.mean[~force]))
    return rows


def force_row(kind: str, depth: float, model: float, mean: float, sd: float) -> Row:
    """Return the row of a force."""
    off = (model - mean) / sd
    return Row(
        f"{kind}, {depth:.1f} mm",
        f"{mean:.3f} ± {sd:.3f} N",
        f"{model:.4f} N, {off:+.2f} sd",
        said(abs(off) <= 1),
    )


def profile_row(kind: str, model: np.ndarray, mean: np.ndarray) -> Row:
    """Return the row of a profile."""
    r2, rms = r_squared(model, mean), float(np.sqrt(np.mean((model - mean) ** 2)))
    measured = f"R² at least {LEAST_R2}"
    return Row(
        f"profile under the {kind}", measured, f"{r2:.4f}, rms {rms:.3f} mm", said(r2 >= LEAST_R2)
    )


# %%
def letters(depth: float, finger: Finger, tissue: Tissue | None = None) -> list[Row]:
    """Press the letters at both speeds, with the default tissues or others."""
    rows = []
    for speed in (20.0, 0.2):
        study = Study(
            finger=finger,
            tissue=tissue or Tissue(),
            stimulus=Text(),
            protocol=Protocol(depth_mm=depth, distance_mm=0.0, press_speed_mm_s=speed),
            receptors=Receptors(spacing_mm=5.0),
        )
        force = float(scan(study).trace.force_N[-1, 2])
        off = force / FORCE_N - 1
        rows.append(
            Row(
                f"letters at {depth:g} mm, {speed:g} mm/s",
                f"{FORCE_N} N ± {GATE:.0%}",
                f"{force:.3f} N, {off:+.1%}",
                said(abs(off) <= GATE),
            )
        )
    return rows


# %% [markdown]
# The plate's press is one scan to each force, so that the strains are read at exactly that force.


# %%
def plate(finger: Finger, folder: Path, forces: tuple[float, float]) -> list[Row]:
    """Press a plate: areas, volume, strains of the layers."""
    mesh = finger.mesh()
    strains, trace = {}, None
    for force in forces:
        study = Study(
            finger=finger,
            stimulus=Plate(),
            protocol=Protocol(force_N=force, distance_mm=0.0, press_speed_mm_s=0.2),
            receptors=Receptors(spacing_mm=5.0),
            solver=Solver(max_press_step_mm=0.125),
        )
        place = folder / f"plate_{force:g}N"
        trace = scan(study, place, overwrite=True).trace
        if MPI.COMM_WORLD.rank == 0:
            strains[force] = layer_strains(mesh, Results.open(place).load_checkpoint()["u"])
    if MPI.COMM_WORLD.rank:
        return []
    normal = trace.force_N[:, 2]
    rows = []
    for at, (least, largest) in AREA_GATES.items():
        if at <= normal[-1]:
            area = float(np.interp(at, normal, trace.contact_area_mm2))
            gate = f"{least:.0f} to {largest:.0f} mm²"
            met = least <= area <= largest
            rows.append(Row(f"contact area at {at:g} N", gate, f"{area:.1f} mm²", said(met)))
    loss = float(-trace.volume_change.min())
    rows.append(
        Row(
            f"volume lost, plate at {forces[-1]:g} N",
            f"at most {LARGEST_LOSS:.0%}",
            f"{loss:.1%}",
            said(loss <= LARGEST_LOSS),
        )
    )
    return rows + strain_rows(strains, forces)


def layer_strains(mesh: FingerMesh, displacement: np.ndarray) -> dict[str, float]:
    """Return the mean of the largest compressive strain of each layer at the contact's centre."""
    found = {}
    for tissue in ("stratum_corneum", "epidermis"):
        inside = under_contact(mesh, tissue, CENTRE_MM)
        found[tissue] = float(-principal_strains(mesh, displacement, tissue)[inside, 0].mean())
    return found


def strain_rows(
    strains: Mapping[float, dict[str, float]], forces: tuple[float, float]
) -> list[Row]:
    """Return the rows of the layers' strains."""
    low, high = (strains[force] for force in forces)
    share = low["epidermis"] / high["epidermis"]
    corneum, epidermis = high["stratum_corneum"], high["epidermis"]
    at = f"{forces[1]:g} N"
    return [
        Row(
            f"compression of stratum corneum, {at}", "< 10 %", f"{corneum:.1%}", said(corneum < 0.1)
        ),
        Row(f"compression of epidermis, {at}", "> 20 %", f"{epidermis:.1%}", said(epidermis > 0.2)),
        Row(f"share of it at {forces[0]:g} N", "> 50 %", f"{share:.0%}", said(share > 0.5)),
    ]


# %%
def sliding(finger: Finger, normal: float, distance: float, forces: tuple[float, ...]) -> list[Row]:
    """Drag a plate: stiffness, slip from the rim, way to full slip."""
    stiffness = [tangential_stiffness(finger, force, DRAG_FRICTION) for force in forces]
    steps = list(drag_plate(finger, normal, DRAG_FRICTION, distance))
    slope, offset = np.polyfit(forces, stiffness, 1)
    r2 = r_squared(offset + slope * np.array(forces), np.array(stiffness))
    return [
        Row(
            f"tangential stiffness, {forces[0]:g} to {forces[-1]:g} N",
            "grows linearly",
            ", ".join(f"{value:.2f}" for value in stiffness) + f" N/mm, R2 {r2:.3f}",
            said(slope > 0 and r2 > 0.95),
        ),
        *slip_rows(steps, normal),
    ]


def slip_rows(steps: list[Drag], normal: float) -> list[Row]:
    """Return the rows of how slip spreads and when all skin slips."""
    partly = [step for step in steps if 0.1 < step.stuck < 0.9]
    inner = float(np.mean([step.stuck_radius for step in partly])) if partly else float("nan")
    end = full_slip(steps)
    way = "not within the slide" if end is None else f"{end.skin_mm:.2f} mm"
    return [
        Row(
            "sticking skin while part of it slips",
            "centre",
            f"{inner:.2f} of the mean radius",
            said(inner < 0.9),
        ),
        Row(
            f"drag before all slips, {normal:g} N, friction {DRAG_FRICTION:g}",
            "3.4 mm (0.9 to 6.3)",
            way,
            said(end is not None and 0.9 <= end.skin_mm <= 6.3),
        ),
    ]


# %%
if __name__ == "__main__":
    run_script(main)
