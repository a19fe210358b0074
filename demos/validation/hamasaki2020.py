# %% [markdown]
# # The paper, its reproduction and the default finger side by side
#
# Hamasaki et al. 2020 (DOI 10.1177/1687814020984651) pressed the letters F G H on a finger of
# finite elements and let the neurons of its receptors fire. For each statement and figure of the
# paper that is known, this script computes the same with the shipped study "hamasaki2020" and with
# the default finger, prints a table and draws the pictures of the page "The paper, side by side".
#
# - The neuron of "hamasaki2020" is fitted to rates under four cylinders. The paper's rates are not
#   at hand, so these are evenly spaced in the ranges that are known; the letters are not used.
#   The cylinders are pressed as deep as the letters, so that the fit covers their SED.
# - Mechanics does not depend on the neuron: all scans have the default one, and the study's neuron
#   is applied to their histories.
# - The passes of a single fibre, 0.2 mm apart, are three scans 2 mm apart: in each, the ten
#   receptors within 1 mm of the middle stand in for one receptor in ten passes.
#
#     python demos/validation/hamasaki2020.py results/paper --jobs 2
#
# These are 20 scans of the coarse finger, half an hour on two cores; started again, it continues.

# %%
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from hamasaki2020_figures import figures, sections
from hamasaki2020_readings import (
    CURVATURES,
    CYLINDER_MM,
    HOLD_S,
    PLATE,
    PROFILE,
    RAMP_S,
    WINDOWS_MM,
    Finger,
    Middle,
)

from tactile_fem import Study, load_study, run_script, write_table
from tactile_fem.output.histories import extrema
from tactile_fem.runtime.estimates import r_squared
from tactile_fem.series import Member, RateImage, run_all
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

PASS_MM = 0.2  # slide positions of shifted passes
BESIDE_MM = np.arange(1.0, 5.0)


# %%
def main(
    folder: Path,
    *,
    distance: float = 10.0,
    depth: float = 1.97,
    shifts: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (-2, 0, 2),
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
        Of the letters across the finger, evenly spaced, 0 included.
    set_
        Further values of both studies, ``section.key=value``.
    jobs
        Parallel scans.
    """
    own = [f"protocol.depth_mm={depth}", f"protocol.distance_mm={distance}", *set_]
    studies = {"reproduction": load_study("hamasaki2020", own), "default": load_study(None, own)}
    members = [one for name, study in studies.items() for one in members_of(name, study, shifts)]
    members.sort(key=lambda member: "shift_mm" in member.values)
    scans = run_all(members, folder, jobs=jobs)
    fingers = {name: Finger(study, {}) for name, study in studies.items()}
    for member, scan in zip(members, scans, strict=True):
        name, _, of_finger = member.name.partition("-")
        fingers[name].scans[of_finger] = scan
    print_fit(fingers["reproduction"])
    rows = list(table(*fingers.values()))
    print("\n| figure | paper | reproduction | default |\n| --- | --- | --- | --- |")
    for row in rows:
        print(f"| {row.figure} | {row.paper} | {row.reproduction} | {row.default} |")
    write_table(folder / "hamasaki2020.csv", rows)
    for name, figure in figures(fingers).items():
        figure.savefig(folder / f"paper_{name}.png", dpi=110)
    sections(fingers["reproduction"], folder / "paper_sections.png")


# %%
def members_of(name: str, study: Study, shifts: tuple[float, ...]) -> Iterator[Member]:
    """Yield the scans of a finger: the letters, presses, and shifted letters."""
    study = study.model_copy(update={"neuron": Neuron(), "output": Output(pictures=False)})
    press = study.model_copy(update={"receptors": Receptors(half_width_mm=0.0)})
    slow = {"press_speed_mm_s": 0.2, "distance_mm": 0.0}
    ramp = Press(depth_mm=CYLINDER_MM, speed_mm_s=CYLINDER_MM / RAMP_S)
    held = Protocol(path=(ramp, Hold(time_s=HOLD_S, output_s=HOLD_S / 2)))
    presses = {
        "plate": (Plate(), Protocol(depth_mm=2.0, **slow)),
        "edge": (Edge(radius_mm=0.025), Protocol(depth_mm=1.0, **slow)),
        "cylinder": (PROFILE.indenter, Protocol(depth_mm=1.0, **slow)),
        **{f"cylinder-{c}": (Cylinder(radius_mm=25.4 / c), held) for c in CURVATURES},
    }
    yield Member(f"{name}-letters", study, {"finger": name})
    for key, (body, protocol) in presses.items():
        one = press.model_copy(update={"stimulus": body, "protocol": protocol})
        yield Member(f"{name}-{key}", one, {"finger": name})
    for shift in filter(None, shifts):
        body = study.stimulus.model_copy(update={"shift_mm": (shift, 0.0)})
        coarser = study.protocol.model_copy(update={"output_mm": PASS_MM})
        one = study.model_copy(update={"stimulus": body, "protocol": coarser})
        yield Member(f"{name}-letters{shift:+g}", one, {"finger": name, "shift_mm": shift})


def print_fit(finger: Finger) -> None:
    """Print the constants that the assumed rates under the cylinders give, and the study's."""
    for name, estimate in finger.fitted_neuron().estimates.items():
        print(f"{name} {estimate.value:.4g}, in the study {getattr(finger.study.neuron, name):g}")


# %%
@dataclass(frozen=True)
class Row:
    """A statement of the paper, and what the two fingers give."""

    figure: str
    paper: str
    reproduction: str
    default: str


def table(*fingers: Finger) -> Iterator[Row]:
    """Yield the rows in the order of the paper's figures."""

    def row(figure: str, paper: str, say: Callable[[Finger], str]) -> Row:
        return Row(figure, paper, *map(say, fingers))

    yield row("", "81,000 tetrahedra", lambda f: f"{len(f.study.finger.mesh().cells):,}")
    yield row("", "letters: 0.6 N at 1.97 mm", lambda f: f"{f.pressed_N():.3f} N")
    yield row("3a", f"plate: {listed(PLATE.mean, 3)} N (measured)", plate_forces)
    yield row("3b", "profile beside a sharp edge", edge_profile)
    yield row("3b", "profile under a cylinder of 3.17 mm (measured)", profile_r2)
    yield row("5, 6", "ramp: rate rises with curvature", lambda f: per_s(f.rates_Hz()[:, 0]))
    yield row("5, 6", "hold: likewise", lambda f: per_s(f.rates_Hz()[:, 1]))
    yield from middle_rows([finger.middle() for finger in fingers], fingers)
    yield row("9a", "population", lambda f: image_numbers(f, f.population(half_width_of(f))))
    yield row("9b", "one fibre, the same places", lambda f: image_numbers(f, f.fibre()))


def middle_rows(seen: list[Middle], fingers: tuple[Finger, ...]) -> Iterator[Row]:
    """Yield the rows of the middle afferent."""
    yield Row("8a", "maxima of SED", *map(maxima, seen))
    rates = [
        one.rates_Hz(finger.study.protocol.speed_mm_s)
        for one, finger in zip(seen, fingers, strict=True)
    ]
    for k, (start, end) in enumerate(pairwise(WINDOWS_MM)):
        window = f"{start:g} to {end:g} mm: {'fires' if k % 2 else 'silent'}"
        yield Row("8b", window, *(f"{own[k]:.0f}/s" for own in rates))
    yield Row("8b", "three bundles", *(", ".join(one.bundles()) or "none" for one in seen))


def listed(values: np.ndarray, digits: int) -> str:
    """Return numbers as a table writes them."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def per_s(rates: np.ndarray) -> str:
    """Return rates under the cylinders."""
    return f"{listed(rates, 0)}/s"


def plate_forces(finger: Finger) -> str:
    """Return the plate's forces and how many standard deviations they are off."""
    force = np.interp(PLATE.depth_mm, *finger.plate())
    off = ", ".join(f"{value:+.1f}" for value in (force - PLATE.mean) / PLATE.sd)
    return f"{listed(force, 3)} N ({off} sd)"


def edge_profile(finger: Finger) -> str:
    """Return the skin's deflection beside the sharp edge."""
    return f"{listed(finger.profile('edge', BESIDE_MM), 2)} mm at 1, 2, 3, 4 mm"


def profile_r2(finger: Finger) -> str:
    """Return how well the profile under a cylinder agrees with the measured one."""
    return f"R² {r_squared(finger.profile('cylinder', PROFILE.place_mm), PROFILE.mean):.3f}"


def maxima(seen: Middle) -> str:
    """Return where SED has maxima and how large they are."""
    highs, _ = extrema(seen.sed_kPa)
    places = (f"{seen.along_mm[k]:.1f} mm ({seen.sed_kPa[k]:.2f} kPa)" for k in highs)
    return ", ".join(places) or "none"


def half_width_of(finger: Finger) -> float:
    """Return the largest distance from the middle that one fibre's rows have."""
    return float(np.abs(finger.fibre().across_mm).max())


def image_numbers(finger: Finger, image: RateImage) -> str:
    """Return rows, spikes and likeness to the letters of a raster."""
    spikes = image.response.counts().sum()
    return f"{len(image.across_mm)} rows, {spikes:,} spikes, r {finger.outline_r(image):.2f}"


# %%
if __name__ == "__main__":
    run_script(main)
