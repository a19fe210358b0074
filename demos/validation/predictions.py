# %% [markdown]
# # What the finger is fitted to, and what it predicts
#
# Every measurement beside the model in one table. Tissues and pad were fitted to the forces on a
# plate and a probe and to the skin's profile under a cylinder (`tactile-fem fit`, `measured/`).
# Everything else is predicted:
#
# - the letters F G H 1.97 mm deep at two speeds: 0.6 N (Hamasaki et al. 2020), ± 15 %,
# - a plate up to 3.5 N: contact area at 0.25, 0.5 and 1 N (wide ranges, because fingers differ),
#   volume lost (at most 5 %), and the largest compressive strain in the layers of the skin
#   (Corniani et al. 2025, eLife 93554),
# - a plate that is dragged across the pad (`slip.py`): tangential stiffness over the normal force
#   (Pataky et al. 2005: linear), slip from the rim (Delhaye et al. 2014), and how far the skin is
#   dragged before all of it slips (3.4 mm, 0.9 to 6.3, with less than 0.5 N; eLife 93554).
#
#     python demos/validation/predictions.py results/predictions
#     python demos/validation/predictions.py results/medium --preset medium

# %%
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from slip import drag as drag_plate
from slip import full_slip, tangential_stiffness
from strains import principal_strains, under_contact

from tactile_fem import (
    Experiment,
    FingerMesh,
    Results,
    Study,
    read_measurements,
    run_script,
    scan,
    write_table,
)
from tactile_fem.calibration.press import press
from tactile_fem.neuron import r_squared
from tactile_fem.study import Finger, Plate, Protocol, Receptors, Solver, Text, Tissue

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

MEASURED = Path(__file__).parent / "measured"
FITTED = "plate", "probe", "cylinder"
LEAST_R2 = 0.97
LETTERS_MM, LETTERS_N, LETTERS_GATE = 1.97, 0.6, 0.15
PLATE_N = (0.5, 3.5)
AREAS_MM2 = {0.25: (40.0, 70.0), 0.5: (60.0, 90.0), 1.0: (90.0, 130.0)}  # by force, N
LARGEST_LOSS = 0.05
CENTRE_MM = 2.0  # half of the square in which strains are averaged
STIFFNESS_N = (0.25, 0.5, 1.0, 2.0)
DRAG_N, DRAG_FRICTION, DRAG_MM = 0.4, 0.8, 6.0


@dataclass(frozen=True)
class Row:
    """A quantity, its measurement and the model."""

    quantity: str
    measured: str
    model: str
    met: str


def row(quantity: str, measured: str, model: str, met: Any) -> Row:
    """Return a row of the table that says whether its target is met."""
    return Row(quantity, measured, model, "yes" if met else "**missed**")


def tabulate(path: Path, *parts: Callable[[], list[Row]]) -> None:
    """Print and write the rows of each part as soon as they are known."""
    rows: list[Row] = []
    for part in parts:
        found = part()
        rows += found
        if MPI.COMM_WORLD.rank == 0:
            for one in found:
                print(f"| {' | '.join(vars(one).values())} |", flush=True)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_table(path, rows)


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    deepest: float = 3.0,
    depth: float = LETTERS_MM,
    forces: tuple[float, float] = PLATE_N,
    drag: float = DRAG_N,
    distance: float = DRAG_MM,
    stiffness_forces: tuple[float, ...] = STIFFNESS_N,
) -> None:
    """Print the table; lengths in mm, forces in N.

    Parameters
    ----------
    folder
        Folder for the table and the plate's presses.
    preset, pad_size, far_size
        The mesh.
    deepest
        Largest depth of the measurements that were fitted.
    depth, forces
        Depth of the letters, and forces of the plate's presses.
    drag, distance, stiffness_forces
        Normal force and length of the plate's slide, and normal forces of the stiffness.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    tabulate(
        folder / "predictions.csv",
        lambda: fitted(finger, deepest),
        lambda: letters(depth, finger),
        lambda: plate(finger, folder, forces),
        lambda: sliding(finger, drag, distance, stiffness_forces),
    )


# %%
def fitted(finger: Finger, deepest: float) -> list[Row]:
    """Press the indenters to which the tissues were fitted, up to a depth."""
    study = Study(finger=finger, solver=Solver(max_press_step_mm=0.25))
    rows = []
    for experiment in read_measurements([MEASURED / f"{name}.csv" for name in FITTED]):
        inside = up_to(experiment, deepest)
        if not len(inside.mean):
            continue
        values, kind, mean = press(study, inside).values, inside.indenter.kind, inside.mean
        if inside.is_force.all():
            for at, sd, model, wanted in zip(inside.depth_mm, inside.sd, values, mean, strict=True):
                off = (model - wanted) / sd
                measured = f"{wanted:.3f} ± {sd:.3f} N"
                told = f"{model:.4f} N, {off:+.2f} sd"
                rows.append(row(f"{kind}, {at:.1f} mm", measured, told, abs(off) <= 1))
        else:
            r2, rms = r_squared(values, mean), float(np.sqrt(np.mean((values - mean) ** 2)))
            measured, told = f"R² at least {LEAST_R2}", f"{r2:.4f}, rms {rms:.3f} mm"
            rows.append(row(f"profile under the {kind}", measured, told, r2 >= LEAST_R2))
    return rows


def up_to(experiment: Experiment, deepest_mm: float) -> Experiment:
    """Return the part of an experiment up to a depth."""
    keep = experiment.depth_mm <= deepest_mm
    names = ("depth_mm", "place_mm", "mean", "sd")
    return replace(experiment, **{name: getattr(experiment, name)[keep] for name in names})


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
        off = force / LETTERS_N - 1
        name, measured = f"letters at {depth:g} mm, {speed:g} mm/s", f"{LETTERS_N} N ± 15 %"
        rows.append(row(name, measured, f"{force:.3f} N, {off:+.1%}", abs(off) <= LETTERS_GATE))
    return rows


# %%
def plate(finger: Finger, folder: Path, forces: tuple[float, float]) -> list[Row]:
    """Press a plate to each force: areas, volume, strains of the layers at exactly that force."""
    mesh = finger.mesh()
    strains, trace = [], None
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
            strains.append(layer_strains(mesh, Results.open(place).load_checkpoint()["u"]))
    if MPI.COMM_WORLD.rank:
        return []
    normal, rows = trace.force_N[:, 2], []
    for at, (least, largest) in AREAS_MM2.items():
        if at <= normal[-1]:
            area = float(np.interp(at, normal, trace.contact_area_mm2))
            gate, met = f"{least:.0f} to {largest:.0f} mm²", least <= area <= largest
            rows.append(row(f"contact area at {at:g} N", gate, f"{area:.1f} mm²", met))
    loss, at = float(-trace.volume_change.min()), f"{forces[1]:g} N"
    low, high = strains
    corneum, epidermis = high["stratum_corneum"], high["epidermis"]
    share = low["epidermis"] / epidermis
    name = f"compression of epidermis, {at}"
    return [
        *rows,
        row(f"volume lost, plate at {at}", "at most 5%", f"{loss:.1%}", loss <= LARGEST_LOSS),
        row(f"compression of stratum corneum, {at}", "< 10 %", f"{corneum:.1%}", corneum < 0.1),
        row(name, "> 20 %", f"{epidermis:.1%}", epidermis > 0.2),
        row(f"share of it at {forces[0]:g} N", "> 50 %", f"{share:.0%}", share > 0.5),
    ]


def layer_strains(mesh: FingerMesh, displacement: np.ndarray) -> dict[str, float]:
    """Return the mean of the largest compressive strain of each layer at the contact's centre."""
    found = {}
    for tissue in ("stratum_corneum", "epidermis"):
        inside = under_contact(mesh, tissue, CENTRE_MM)
        found[tissue] = float(-principal_strains(mesh, displacement, tissue)[inside, 0].mean())
    return found


# %%
def sliding(finger: Finger, normal: float, distance: float, forces: tuple[float, ...]) -> list[Row]:
    """Drag a plate: stiffness, slip from the rim, way to full slip."""
    stiffness = np.array([tangential_stiffness(finger, force, DRAG_FRICTION) for force in forces])
    steps = list(drag_plate(finger, normal, DRAG_FRICTION, distance))
    slope, offset = np.polyfit(forces, stiffness, 1)
    r2 = r_squared(offset + slope * np.array(forces), stiffness)
    partly = [step.stuck_radius for step in steps if 0.1 < step.stuck < 0.9]
    inner, end = float(np.mean(partly)) if partly else float("nan"), full_slip(steps)
    name = f"tangential stiffness, {forces[0]:g} to {forces[-1]:g} N"
    told = ", ".join(f"{value:.2f}" for value in stiffness) + f" N/mm, R2 {r2:.3f}"
    way = "not within the slide" if end is None else f"{end.skin_mm:.2f} mm"
    sticks, radius = "sticking skin while part of it slips", f"{inner:.2f} of the mean radius"
    slips = f"drag before all slips, {normal:g} N, friction {DRAG_FRICTION:g}"
    met = end is not None and 0.9 <= end.skin_mm <= 6.3
    return [
        row(name, "grows linearly", told, slope > 0 and r2 > 0.95),
        row(sticks, "centre", radius, inner < 0.9),
        row(slips, "3.4 mm (0.9 to 6.3)", way, met),
    ]


# %%
if __name__ == "__main__":
    run_script(main)
