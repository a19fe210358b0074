# %% [markdown]
# # How a finger pad relaxes
#
# This demo emphasizes
# - presses, holds at a depth or a force, and taps as pieces of a path,
# - measured relaxation beside the model's in one table: first what the shares of the series were
#   fitted to (`fit_relaxation.py`), then all the others.
#
# A plate is pressed into the pad. What has been measured of pads and of skin:
#
# - the force on a small tip that is held falls by 17 % from 1.0 to 5.5 s at 50 mN and by 10 % from
#   1.5 to 5.5 s at 200 mN (raw recordings; the specimen is not named),
# - a tap on a rigid plate, some 100 ms long, loses 81 % of its energy in the pad (Jindrich et al.
#   2003); the time course of the compression is not at hand, so this one is proposed,
# - three exponentials of 4 ms, 70 ms and 1.4 s and a constant describe a flat probe that presses
#   and holds (Pawluk and Howe 1999, DOI 10.1115/1.2835100); fast presses are stiffer,
# - skin relaxes about twice as fast as it creeps (Wang and Hayward 2007).
#
#     python demos/validation/relaxation.py results/relaxation

# %%
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from letters_force import DEPTH_MM
from predictions import Row, letters, said, tabulate

from tactile_fem import Piece, Study, run_script, scan
from tactile_fem.simulation.trace import Trace
from tactile_fem.study import Finger, Hold, Lift, Plate, Press, Protocol, Receptors, Tissue

# Normal force in N, beginning and end in s after the press, and the share that is lost.
FALLS = ((0.05, 1.0, 5.5, 0.17), (0.2, 1.5, 5.5, 0.10))
FALL_BAND = 0.10, 0.17
TAP_LOSS = 0.81
FAST_MM_S = 20.0
# Of the tap: depth in mm, and how long it presses, stays and lifts, in s.
TAP_MM, TAP_S = 1.5, (0.010, 0.060, 0.040)
SLOW_TAP_S = tuple(2 * time for time in TAP_S)
SPEEDS_MM_S = (0.2, 2.0, 20.0, 200.0)
PRESS_MM = 1.0
CREEP_N = 0.2
CREEP_RATIO = 1.5, 2.5
# Holds in a row, ever longer, with this many outputs each, s.
HOLDS_S, OUTPUTS = (0.01, 0.04, 0.15, 0.6, 2.4, 4.0), 5


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    press: float = PRESS_MM,
    depth: float = DEPTH_MM,
    g: tuple[float, float, float] | None = None,
    outputs: int = OUTPUTS,
) -> None:
    """Print the table.

    Parameters
    ----------
    folder
        For the table.
    preset, pad_size, far_size
        The mesh.
    press, depth
        Depths of the presses at several speeds and of the letters, mm.
    g
        Shares of the three times, in place of those of `tissue.relaxation = "fingerpad"`.
    outputs
        Steps of each part of a hold, at least.
    """
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    tissue = Tissue(relaxation="fingerpad") if g is None else relaxing(g)
    tabulate(
        folder / "relaxation.csv",
        lambda: falls(finger, tissue, outputs),
        lambda: taps(finger, tissue),
        lambda: presses(finger, tissue, press),
        lambda: relaxation_and_creep(finger, tissue, outputs),
        lambda: letters(depth, finger, tissue),
    )


def relaxing(g: Sequence[float]) -> Tissue:
    """Return the default tissues with other shares of the finger pad's relaxation."""
    fingerpad = Tissue(relaxation="fingerpad")
    series = {
        name: {"g": tuple(g), "tau_s": own.tau_s}
        for name, own in fingerpad
        if getattr(own, "g", ())
    }
    return Tissue.model_validate({"relaxation": "fingerpad", **series})


def moved(finger: Finger, tissue: Tissue, pieces: Sequence[Piece]) -> Trace:
    """Return the history of a plate that moves along pieces of a path."""
    study = Study(
        finger=finger,
        tissue=tissue,
        stimulus=Plate(),
        protocol=Protocol(path=tuple(pieces)),
        receptors=Receptors(spacing_mm=5.0),
    )
    return scan(study).trace


# %% [markdown]
# Times count from the end of the press. The holds are ever longer, so that their outputs follow
# all three exponentials.


# %%
def held(outputs: int, force_N: float | None = None) -> list[Hold]:
    """Return a hold of 7 s at the depth, or at a normal force."""
    return [Hold(time_s=t, output_s=t / outputs, force_N=force_N) for t in HOLDS_S]


@cache
def press_and_hold(finger: Finger, tissue: Tissue, force_N: float, outputs: int) -> Trace:
    """Return the history of a fast press to a force and a hold at the depth reached."""
    press = Press(force_N=force_N, speed_mm_s=FAST_MM_S)
    return moved(finger, tissue, [press, *held(outputs)])


def fall(
    finger: Finger,
    tissue: Tissue,
    force_N: float,
    start_s: float,
    end_s: float,
    outputs: int = OUTPUTS,
) -> float:
    """Return the share of the force lost between two times of a hold after a fast press."""
    trace = press_and_hold(finger, tissue, force_N, outputs)
    start, end = np.interp([start_s, end_s], trace.time_s, trace.force_N[:, 2])
    return float(1 - end / start)


def falls(finger: Finger, tissue: Tissue, outputs: int) -> list[Row]:
    """Press fast and hold the depth."""
    rows = []
    least, most = FALL_BAND
    for force, start, end, measured in FALLS:
        lost = fall(finger, tissue, force, start, end, outputs)
        rows.append(
            Row(
                f"fall of {force:g} N, {start:g} to {end:g} s (fitted)",
                f"{measured:.0%} ({least:.0%} to {most:.0%})",
                f"{lost:.1%}",
                said(least <= lost <= most),
            )
        )
    return rows


# %%
def tap_loss(finger: Finger, tissue: Tissue, times_s: Sequence[float]) -> float:
    """Return the share of a tap's energy that is lost."""
    into, stay, out = times_s
    pieces = [
        Press(depth_mm=TAP_MM, speed_mm_s=TAP_MM / into),
        Hold(time_s=stay),
        Lift(speed_mm_s=TAP_MM / out),
    ]
    work = moved(finger, tissue, pieces).work_mJ
    return float(1 + work[work < 0].sum() / work[work > 0].sum())


def taps(finger: Finger, tissue: Tissue) -> list[Row]:
    """Tap, as the shares were fitted to, and half as fast."""
    rows = []
    for times, name in ((TAP_S, "(fitted)"), (SLOW_TAP_S, "")):
        lost = tap_loss(finger, tissue, times)
        rows.append(
            Row(
                f"energy lost in a tap of {1e3 * sum(times):.0f} ms {name}".rstrip(),
                f"{TAP_LOSS:.0%}, hardly faster or slower",
                f"{lost:.1%}",
                said(abs(lost - TAP_LOSS) <= 0.05),
            )
        )
    return rows


# %%
def presses(finger: Finger, tissue: Tissue, depth: float) -> list[Row]:
    """Press to a depth, mm, at several speeds."""
    forces = [
        float(moved(finger, tissue, [Press(depth_mm=depth, speed_mm_s=speed)]).force_N[-1, 2])
        for speed in SPEEDS_MM_S
    ]
    told = ", ".join(f"{force:.3f}" for force in forces)
    speeds = ", ".join(f"{speed:g}" for speed in SPEEDS_MM_S)
    stiffer = bool(np.all(np.diff(forces) > 0))
    name = f"force at {depth:g} mm, {speeds} mm/s"
    return [Row(name, "faster is stiffer", f"{told} N", said(stiffer))]


# %% [markdown]
# Relaxation and creep are compared by the time at which half of the change in 7 s is done.


# %%
def relaxation_and_creep(finger: Finger, tissue: Tissue, outputs: int) -> list[Row]:
    """Hold the depth, and hold the force."""
    press = Press(force_N=CREEP_N, speed_mm_s=FAST_MM_S)
    relaxed = press_and_hold(finger, tissue, CREEP_N, outputs)
    crept = moved(finger, tissue, [press, *held(outputs, CREEP_N)])
    relaxes = half_time(relaxed.time_s, relaxed.force_N[:, 2])
    creeps = half_time(crept.time_s, crept.depth_mm)
    least, most = CREEP_RATIO
    return [
        Row(
            f"half of relaxation and of creep, {CREEP_N:g} N",
            "creep takes about twice as long",
            f"{relaxes:.3f} and {creeps:.3f} s, {creeps / relaxes:.2f} times",
            said(least <= creeps / relaxes <= most),
        )
    ]


def half_time(time_s: np.ndarray, values: np.ndarray) -> float:
    """Return when half of the change since time 0 is done."""
    later = time_s >= 0
    share = (values[later] - values[later][0]) / (values[-1] - values[later][0])
    return float(np.interp(0.5, share, time_s[later]))


# %%
if __name__ == "__main__":
    run_script(main)
