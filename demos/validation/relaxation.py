# %% [markdown]
# # How a finger pad relaxes, and the fit of the series
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
# With `--fit` the shares of the three times are fitted to both falls and to the tap, with what is
# known before: a quarter each, as remembered of such series.
#
#     python demos/validation/relaxation.py results/relaxation
#     python demos/validation/relaxation.py results/series --fit --pad-size 3 --far-size 6

# %%
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from predictions import LETTERS_MM, Row, letters, row, tabulate
from scipy.optimize import least_squares

from tactile_fem import Piece, Study, run_script, scan, write_table
from tactile_fem.results.trace import Trace
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
CREEP_N, CREEP_RATIO = 0.2, (1.5, 2.5)
# Holds in a row, ever longer, with this many outputs each, s.
HOLDS_S, OUTPUTS = (0.01, 0.04, 0.15, 0.6, 2.4, 4.0), 5
# Of the fit: standard deviations of falls, tap and shares, where it starts, relative differences.
FALL_SD, TAP_SD, BEFORE, BEFORE_SD = 0.02, 0.10, 0.25, 0.05
START, DIFFERENCE = (0.25, 0.25, 0.15), 0.1


# %%
def main(
    folder: Path,
    *,
    fit: bool = False,
    evaluations: int = 3,
    pad_size: float | None = None,
    far_size: float | None = None,
    press: float = 1.0,
    depth: float = LETTERS_MM,
    outputs: int = OUTPUTS,
) -> None:
    """Print the table, or fit the shares.

    Parameters
    ----------
    folder
        Folder for the table.
    fit
        Whether to fit; a coarse mesh suffices for decays and losses, which are ratios.
    evaluations
        Points that the fit tries, apart from those for derivatives.
    pad_size, far_size
        The mesh, mm.
    press, depth
        Depths of the presses at several speeds and of the letters, mm.
    outputs
        Least number of steps of each part of a hold.
    """
    finger = Finger(pad_size_mm=pad_size, far_size_mm=far_size)
    if fit:
        fit_shares(folder / "fit.csv", finger, evaluations, outputs)
        return
    tissue = Tissue(relaxation="fingerpad")
    tabulate(
        folder / "relaxation.csv",
        lambda: falls(finger, tissue, outputs),
        lambda: taps(finger, tissue),
        lambda: presses(finger, tissue, press),
        lambda: relaxation_and_creep(finger, tissue, outputs),
        lambda: letters(depth, finger, tissue),
    )


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


def fall(finger: Finger, tissue: Tissue, outputs: int, force_N: float, *when_s: float) -> float:
    """Return the share of the force lost between two times of a hold after a fast press."""
    trace = press_and_hold(finger, tissue, force_N, outputs)
    start, end = np.interp(when_s, trace.time_s, trace.force_N[:, 2])
    return float(1 - end / start)


def falls(finger: Finger, tissue: Tissue, outputs: int) -> list[Row]:
    """Press fast and hold the depth."""
    rows, (least, most) = [], FALL_BAND
    for force, start, end, measured in FALLS:
        lost = fall(finger, tissue, outputs, force, start, end)
        name = f"fall of {force:g} N, {start:g} to {end:g} s (fitted)"
        band = f"{measured:.0%} ({least:.0%} to {most:.0%})"
        rows.append(row(name, band, f"{lost:.1%}", least <= lost <= most))
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
    for times, how in ((TAP_S, " (fitted)"), (SLOW_TAP_S, "")):
        lost = tap_loss(finger, tissue, times)
        name = f"energy lost in a tap of {1e3 * sum(times):.0f} ms{how}"
        rows.append(row(name, f"{TAP_LOSS:.0%}", f"{lost:.1%}", abs(lost - TAP_LOSS) <= 0.05))
    return rows


# %%
def presses(finger: Finger, tissue: Tissue, depth: float) -> list[Row]:
    """Press to a depth, mm, at several speeds."""
    forces = [
        float(moved(finger, tissue, [Press(depth_mm=depth, speed_mm_s=speed)]).force_N[-1, 2])
        for speed in SPEEDS_MM_S
    ]
    name = f"force at {depth:g} mm, {', '.join(f'{speed:g}' for speed in SPEEDS_MM_S)} mm/s"
    told = ", ".join(f"{force:.3f}" for force in forces)
    return [row(name, "faster is stiffer", f"{told} N", np.all(np.diff(forces) > 0))]


def relaxation_and_creep(finger: Finger, tissue: Tissue, outputs: int) -> list[Row]:
    """Hold the depth, and hold the force: when half of the change in 7 s is done."""
    press = Press(force_N=CREEP_N, speed_mm_s=FAST_MM_S)
    relaxed = press_and_hold(finger, tissue, CREEP_N, outputs)
    crept = moved(finger, tissue, [press, *held(outputs, CREEP_N)])
    relaxes = half_time(relaxed.time_s, relaxed.force_N[:, 2])
    creeps = half_time(crept.time_s, crept.depth_mm)
    ratio, (least, most) = creeps / relaxes, CREEP_RATIO
    name = f"half of relaxation and of creep, {CREEP_N:g} N"
    told = f"{relaxes:.3f} and {creeps:.3f} s, {ratio:.2f} times"
    return [row(name, "about twice as long", told, least <= ratio <= most)]


def half_time(time_s: np.ndarray, values: np.ndarray) -> float:
    """Return when half of the change since time 0 is done."""
    later = time_s >= 0
    share = (values[later] - values[later][0]) / (values[-1] - values[later][0])
    return float(np.interp(0.5, share, time_s[later]))


# %%
def fit_shares(path: Path, finger: Finger, evaluations: int, outputs: int) -> None:
    """Fit the shares; print them and write what was tried."""
    fingerpad, tried = Tissue(relaxation="fingerpad"), []
    times = fingerpad.subcutaneous.tau_s
    soft = [name for name, own in fingerpad if getattr(own, "g", ())]
    wanted = np.array([*(share for *_, share in FALLS), TAP_LOSS, BEFORE, BEFORE, BEFORE])
    sd = np.array([*(FALL_SD for _ in FALLS), TAP_SD, BEFORE_SD, BEFORE_SD, BEFORE_SD])

    def misfit(g: np.ndarray) -> np.ndarray:
        series = {name: {"g": tuple(g.tolist()), "tau_s": times} for name in soft}
        tissue = Tissue.model_validate({"relaxation": "fingerpad", **series})
        found = [fall(finger, tissue, outputs, *numbers) for *numbers, _ in FALLS]
        found += [tap_loss(finger, tissue, TAP_S), *g.tolist()]
        names = "fall of 0.05 N", "fall of 0.2 N", "loss of a tap", *(f"g of {t} s" for t in times)
        tried.append(dict(zip(names, found, strict=True)))
        print(", ".join(f"{name} {value:.4f}" for name, value in tried[-1].items()), flush=True)
        return (np.array(found) - wanted) / sd

    fit = least_squares(misfit, START, diff_step=DIFFERENCE, max_nfev=evaluations)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_table(path, tried)
    after = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    for time, value, deviation in zip(times, fit.x, after, strict=True):
        learnt = 1 - (deviation / BEFORE_SD) ** 2
        print(f"g of {time} s: {value:.3f} ± {deviation:.3f}, learnt {learnt:.2f}")


# %%
if __name__ == "__main__":
    run_script(main)
