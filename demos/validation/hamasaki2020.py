# %% [markdown]
# # The paper, its reproduction and the default finger side by side
#
# Hamasaki et al. 2020 (DOI 10.1177/1687814020984651) pressed the letters F G H on a finger of
# finite elements and let a receptor's neuron fire. For each statement and figure of the paper that
# is known, this script computes the same with the shipped study "hamasaki2020" and with the default
# finger, prints a table and draws the pictures of the page "The paper, side by side".
#
# The passes of a single fibre are not 51 scans but five, 2 mm apart: in each, the ten receptors
# within 1 mm of the middle stand in for one receptor and passes 0.2 mm apart.
#
#     python demos/validation/hamasaki2020.py results/paper --jobs 2
#
# It takes 22 scans on the coarse finger, about an hour on two cores; started again, it continues.

# %%
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import shapely
from cyclopts import Parameter
from numpy.typing import ArrayLike

from tactile_fem import Results, Study, draw, load_study, run_script, write_table
from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.calibration.press import deflection
from tactile_fem.finger.deformation import SkinSurface
from tactile_fem.neuron import Recording, Window, fit, mean_rates
from tactile_fem.output.histories import central_receptor, extrema
from tactile_fem.runtime.estimates import r_squared
from tactile_fem.series import Member, RateImage, rate_image, run_all
from tactile_fem.study import (
    Cylinder,
    Edge,
    Hold,
    Neuron,
    Output,
    Plate,
    Press,
    Protocol,
    Receptors,
)

MEASURED = Path(__file__).parent / "measured"
(PLATE,), (PROFILE,) = (read_measurements([MEASURED / f"{n}.csv"]) for n in ("plate", "cylinder"))
# Curvatures of the paper's cylinders, 1/inch, and rates chosen for them from what is known of SA1
# afferents: 100 to 200 spikes/s at the end of the ramp, 10 to 50 after a second, falling.
CURVATURES = (16, 8, 4, 2)
RAMP_HZ, HELD_HZ = np.linspace(200, 100, 4), np.linspace(50, 10, 4)
RAMP_S, HOLD_S, CYLINDER_MM = 0.05, 1.0, 1.0
WHEN = (0.8 * RAMP_S, RAMP_S), (RAMP_S + 0.9 * HOLD_S, RAMP_S + 0.999 * HOLD_S)
# Windows of the slide, mm: the middle afferent of the paper is silent in every second one.
WINDOWS_MM = (0.0, 1.5, 2.3, 5.2, 6.0, 7.3, 8.5, 10.0)
PASS_MM = 0.2  # slide positions of shifted passes
GAP_MM = 0.6  # between bundles: 33 spikes/s at 20 mm/s
ROW_MM, BLUR_MM, LATEST_MM = 0.2, 0.3, 1.5


class Finger(NamedTuple):
    """A study and its scans, by name."""

    study: Study
    scans: dict[str, Results]


@dataclass(frozen=True)
class Row:
    """A statement of the paper, and what the two fingers give."""

    figure: str
    paper: str
    reproduction: str
    default: str


# %% [markdown]
# ## The scans
#
# Mechanics does not depend on the neuron, so all scans have the default one, and the neuron of the
# study is applied to their histories: its constants can be fitted without another scan.


# %%
def main(
    folder: Path,
    *,
    distance: float = 10.0,
    depth: float = 1.97,
    shifts: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (-4, -2, 0, 2, 4),
    set_: Annotated[tuple[str, ...], Parameter(name="--set", consume_multiple=True)] = (),
    jobs: int = 1,
) -> None:
    """Scan, print the table, draw; lengths in mm.

    Parameters
    ----------
    folder
        For scans, table and pictures.
    distance, depth
        Of the letters' slide.
    shifts
        Of the letters across the finger; 0 must be one of them, and all evenly spaced.
    set_
        Further values of both studies, ``section.key=value``.
    jobs
        Parallel scans.
    """
    own = [f"protocol.depth_mm={depth}", f"protocol.distance_mm={distance}", *set_]
    studies = {"reproduction": load_study("hamasaki2020", own), "default": load_study(None, own)}
    members = [
        member for name, study in studies.items() for member in members_of(name, study, shifts)
    ]
    members.sort(key=lambda member: "shift_mm" in member.values)
    found = dict(
        zip([one.name for one in members], run_all(members, folder, jobs=jobs), strict=True)
    )
    fingers = {
        name: Finger(
            study, {key.removeprefix(f"{name}-"): found[key] for key in found if name in key}
        )
        for name, study in studies.items()
    }
    print_fitted_neuron(fingers["reproduction"])
    rows = list(table(*fingers.values()))
    print("\n| figure | paper | reproduction | default |\n| --- | --- | --- | --- |")
    for row in rows:
        print(f"| {row.figure} | {row.paper} | {row.reproduction} | {row.default} |")
    write_table(folder / "hamasaki2020.csv", rows)


def members_of(name: str, study: Study, shifts: tuple[float, ...]) -> Iterator[Member]:
    """Yield the scans of a finger: letters first, then presses, then shifted letters."""
    study = study.model_copy(update={"neuron": Neuron(), "output": Output(pictures=False)})
    press = study.model_copy(update={"receptors": Receptors(half_width_mm=0.0)})
    slow = {"press_speed_mm_s": 0.2, "distance_mm": 0.0}
    ramp = Press(depth_mm=CYLINDER_MM, speed_mm_s=CYLINDER_MM / RAMP_S)
    held = Protocol(path=(ramp, Hold(time_s=HOLD_S, output_s=HOLD_S / 2)))
    presses = {
        "plate": (Plate(), Protocol(depth_mm=2.0, **slow)),
        "edge": (Edge(radius_mm=0.025), Protocol(depth_mm=1.0, **slow)),
        **{f"cylinder-{c}": (Cylinder(radius_mm=25.4 / c), held) for c in CURVATURES},
    }
    yield Member(f"{name}-letters", study, {"finger": name})
    for key, (body, protocol) in presses.items():
        one = press.model_copy(update={"stimulus": body, "protocol": protocol})
        yield Member(f"{name}-{key}", one, {"finger": name})
    for shift in shifts:
        if shift:
            body = study.stimulus.model_copy(update={"shift_mm": (shift, 0.0)})
            coarser = study.protocol.model_copy(update={"output_mm": PASS_MM})
            one = study.model_copy(update={"stimulus": body, "protocol": coarser})
            yield Member(f"{name}-letters{shift:+g}", one, {"finger": name, "shift_mm": shift})


# %% [markdown]
# ## The neuron
#
# The paper fits its linear transduction to rates under cylinders. Its numbers are not at hand, so
# the rates here are evenly spaced in the ranges that are known. The letters are not used.


# %%
def print_fitted_neuron(finger: Finger) -> None:
    """Print the constants that follow from the rates under the cylinders."""
    recordings = [
        Recording(
            time, sed, [Window(*when, [rate]) for when, rate in zip(WHEN, rates, strict=True)]
        )
        for (time, sed), *rates in zip(cylinders(finger), RAMP_HZ, HELD_HZ, strict=True)
    ]
    free = ("static_gain_pA_per_kPa", "dynamic_gain_pA_s_per_kPa", "adaptation")
    found = fit(recordings, finger.study.neuron, free)
    for name, estimate in found.estimates.items():
        print(f"{name} {estimate.value:.4g}, in the study {getattr(finger.study.neuron, name):g}")


def cylinders(finger: Finger) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield times from the first touch and the SED of the receptor under each cylinder."""
    for curvature in CURVATURES:
        trace = finger.scans[f"cylinder-{curvature}"].trace
        yield trace["time_s"] - trace["time_s"][0], trace["sed_kPa"][:, :1]


def rates_of(finger: Finger) -> np.ndarray:
    """Return the rates at the end of the ramp and of the hold, (cylinders, 2)."""
    windows = [Window(*when, [0.0]) for when in WHEN]
    return np.array(
        [mean_rates(*one, windows, finger.study.neuron)[:, 0] for one in cylinders(finger)]
    )


# %% [markdown]
# ## What is read from the scans


# %%
def forces_at(finger: Finger, depths: np.ndarray) -> np.ndarray:
    """Return the normal forces of the flat plate at some depths, N."""
    trace = finger.scans["plate"].trace
    return np.interp(depths, trace["depth_mm"], trace["force_N"][:, 2])


def pressed_N(finger: Finger) -> float:
    """Return the letters' normal force at the end of the press."""
    trace = finger.scans["letters"].trace
    return float(trace["force_N"][trace["time_s"] <= 1e-9][-1, 2])


def profile(finger: Finger, scan: str, places: np.ndarray) -> np.ndarray:
    """Return the skin's deflection at distances from a bar, the mean of both sides, mm."""
    y = np.linspace(-8.0, 8.0, 321)
    skin = SkinSurface(finger.study.finger.mesh(), np.column_stack([np.zeros_like(y), y]))
    moved = skin.deformed_mm(finger.scans[scan].load_checkpoint()["u"])
    return deflection(moved, skin.rest_mm, places, axis=1)


class Middle(NamedTuple):
    """SED of the middle receptor over the slide, and its spikes; places in mm."""

    along_mm: np.ndarray
    sed_kPa: np.ndarray
    spikes_mm: np.ndarray
    bundles: list[str]
    rates_Hz: list[float]


def middle(finger: Finger) -> Middle:
    """Return what the middle afferent feels and how it fires."""
    study, trace = finger.study, finger.scans["letters"].trace
    speed, central = study.protocol.speed_mm_s, central_receptor(trace["receptors_mm"])
    response = study.populations[0].population().fire(trace)
    bundles = [
        f"{speed * one.start_s:.1f} to {speed * one.end_s:.1f} mm ({one.spikes} spikes)"
        for one in response.bundles(GAP_MM / speed)[central]
        if one.end_s > 0
    ]
    rates = [
        float(response.mean_rate(start / speed, end / speed)[central])
        for start, end in pairwise(WINDOWS_MM)
    ]
    slide = trace["time_s"] >= -1e-9
    along, sed = trace["displacement_mm"][slide], trace["sed_kPa"][slide, central]
    return Middle(along, sed, speed * response.spikes[central], bundles, rates)


# %% [markdown]
# The receptor at $x$ passes over $x - s$ of letters that are shifted by $s$.


# %%
def population(finger: Finger) -> RateImage:
    """Return the image that all receptors make in one pass: Fig. 9a."""
    trace = finger.scans["letters"].trace
    return image(finger, trace["receptors_mm"][:, 0], trace["time_s"], trace["sed_kPa"])


def fibre(finger: Finger) -> RateImage:
    """Return the image that the receptors near the middle make in all passes: Fig. 9b."""
    passes = [scan for name, scan in finger.scans.items() if name.startswith("letters")]
    shifts = np.array([scan.study.stimulus.shift_mm[0] for scan in passes])
    reach = np.diff(np.sort(shifts)).min(initial=np.inf) / 2
    time = np.unique(np.concatenate([scan.trace["time_s"] for scan in passes]).round(12))
    rows: dict[float, np.ndarray] = {}
    for shift, scan in zip(shifts, passes, strict=True):
        x = scan.trace["receptors_mm"][:, 0]
        for k in np.flatnonzero((x > -reach - 1e-9) & (x < reach - 1e-9)):
            felt = scan.trace["sed_kPa"][:, k]
            rows[round(float(x[k] - shift), 6)] = np.interp(time, scan.trace["time_s"], felt)
    return image(finger, np.array(list(rows)), time, np.column_stack(list(rows.values())))


def image(finger: Finger, across: np.ndarray, time: np.ndarray, felt: np.ndarray) -> RateImage:
    """Return the image of receptors that pass at some X of the letters."""
    study, order = finger.study, np.argsort(across)
    afferents = study.populations[0].population()
    return rate_image(
        across[order], time, felt[:, order], study.protocol.speed_mm_s, afferents, column_mm=ROW_MM
    )


def outline_r(finger: Finger, rates: RateImage) -> float:
    """Return the correlation of an image with the letters' outline, the largest over its delay."""
    edges = shapely.unary_union([part.boundary for part in finger.study.stimulus.outlines()])
    delays = np.arange(0.0, LATEST_MM, ROW_MM)
    found = []
    for delay in delays:
        places = np.meshgrid(rates.across_mm, rates.along_mm - delay, indexing="ij")
        away = shapely.distance(edges, shapely.points(*places))
        near = np.exp(-0.5 * (away / BLUR_MM) ** 2)
        found.append(np.corrcoef(near.ravel(), rates.rate_Hz.ravel())[0, 1])
    return float(max(found))


# %% [markdown]
# ## The table


# %%
def table(reproduction: Finger, default: Finger) -> Iterator[Row]:
    """Yield the rows in the order of the paper's figures."""
    fingers = (reproduction, default)

    def row(figure: str, paper: str, say: Callable[[Finger], str]) -> Row:
        return Row(figure, paper, *map(say, fingers))

    yield row("mesh", "81,000 tetrahedra", lambda f: f"{len(f.study.finger.mesh().cells):,}")
    yield row("force", "0.6 N at 1.97 mm", lambda f: f"{pressed_N(f):.3f} N")
    yield row("3a", "plate: " + listed(PLATE.mean, 3) + " N", plate_forces)
    yield row("3b", "edge, 1 to 4 mm beside: no numbers at hand", edge_profile)
    yield row("3b", "cylinder of 3.17 mm instead (measured)", profile_r2)
    yield row("5, 6", "ramp: rates fall with the radius", lambda f: listed(rates_of(f)[:, 0]))
    yield row("5, 6", "hold: likewise", lambda f: listed(rates_of(f)[:, 1]))
    seen = {id(finger): middle(finger) for finger in fingers}
    yield row("8a", "SED has maxima and minima", lambda f: extremes(seen[id(f)]))
    for k, (start, end) in enumerate(pairwise(WINDOWS_MM)):
        yield row(
            "8b",
            f"{start:g} to {end:g} mm: {'fires' if k % 2 else 'silent'}",
            lambda f, k=k: f"{seen[id(f)].rates_Hz[k]:.0f}/s",
        )
    yield row("8b", "three bundles", lambda f: "; ".join(seen[id(f)].bundles) or "none")
    for figure, made in (("9a", population), ("9b", fibre)):
        yield row(figure, "raster", lambda f, made=made: image_numbers(f, made(f)))


def listed(values: ArrayLike, digits: int = 0) -> str:
    """Return numbers as a table writes them."""
    return ", ".join(f"{value:.{digits}f}" for value in np.asarray(values))


def plate_forces(finger: Finger) -> str:
    """Return the plate's forces and how many standard deviations they are off."""
    force = forces_at(finger, PLATE.depth_mm)
    off = (force - PLATE.mean) / PLATE.sd
    return f"{listed(force, 3)} N ({', '.join(f'{value:+.1f}' for value in off)} sd)"


def edge_profile(finger: Finger) -> str:
    """Return the skin's deflection beside the sharp edge."""
    return listed(profile(finger, "edge", np.arange(1.0, 5.0)), 2) + " mm"


def profile_r2(finger: Finger) -> str:
    """Return how well the profile under a cylinder agrees with the measured one."""
    model = profile(finger, "cylinder-16", PROFILE.place_mm)
    return f"R² {r_squared(model, PROFILE.mean):.3f}"


def extremes(seen: Middle) -> str:
    """Return where SED has maxima and how large they are."""
    highs, _ = extrema(seen.sed_kPa)
    places = (f"{seen.along_mm[k]:.1f} mm ({seen.sed_kPa[k]:.2f} kPa)" for k in highs)
    return ", ".join(places) or "no maximum"


def image_numbers(finger: Finger, rates: RateImage) -> str:
    """Return rows, spikes and likeness to the letters of a raster."""
    spikes = rates.response.counts().sum()
    return (
        f"{len(rates.across_mm)} rows, {spikes:,} spikes, outline r {outline_r(finger, rates):.2f}"
    )
