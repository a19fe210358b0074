# %% [markdown]
# # The paper, its reproduction and the default finger side by side
#
# Hamasaki et al. 2020 (DOI 10.1177/1687814020984651) pressed the letters F G H on a finger of
# finite elements and let the neurons of its receptors fire. For each statement and figure of the
# paper that is known, this script computes the same with the shipped study "hamasaki2020", on a
# coarse finger and on one of the paper's size, and with the default finger, prints a table and
# draws the pictures of the page "The paper, side by side".
#
# - The neuron of "hamasaki2020" is fitted to rates under four cylinders. The paper's rates are not
#   at hand, so these are evenly spaced in the ranges that are known. The cylinders are pressed as
#   deep as the letters, so that the fit covers their SED.
# - Its decay, which these rates do not determine, is chosen among six by what the paper states of
#   the letters: three bundles, each until SED has its maximum. A second table shows them.
# - Mechanics does not depend on the neuron: all scans have the default one, and the study's neuron
#   is applied to their histories.
# - The passes of a single fibre, 0.2 mm apart, are three scans 2 mm apart: in each, the ten
#   receptors within 1 mm of the middle stand in for one receptor in ten passes.
#
#     python demos/validation/hamasaki2020.py results/paper --jobs 2
#
# These are 20 scans of coarse fingers, ten minutes on two cores, and three of the paper's size,
# half an hour; started again, it continues.

# %%
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from hamasaki2020_figures import figures, sections
from hamasaki2020_readings import (
    BETWEEN_MM,
    BUNDLES_MM,
    CENTRAL_MM,
    CURVATURES,
    CYLINDER_MM,
    HOLD_S,
    OUTER_MM,
    PLATE,
    PROFILE,
    RAMP_S,
    Finger,
    Middle,
    first_high_mm,
    misfit_Hz,
    rows_of,
)

from tactile_fem import Study, load_study, run_script, write_table
from tactile_fem.neuron import r_squared
from tactile_fem.runtime.files import atomic_write
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

FULL = "full size"
DECAYS_S = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
PASS_MM = 0.2  # slide positions of shifted passes
BESIDE_MM = np.arange(1.0, 5.0)
Row = dict[str, str]  # of a table: a statement, and what the fingers give


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
        Folder for scans, table and pictures.
    distance, depth
        Length and depth of the letters' slide.
    shifts
        Shifts of the letters across the finger, evenly spaced, 0 included.
    set_
        Further values of both studies, ``section.key=value``.
    jobs
        Parallel scans.
    """
    own = [f"protocol.depth_mm={depth}", f"protocol.distance_mm={distance}", *set_]
    studies = {
        "reproduction": load_study("hamasaki2020", own),
        FULL: load_study("hamasaki2020", ["finger.preset=paper", *own]),
        "default": load_study(None, own),
    }
    members = [one for name, study in studies.items() for one in members_of(name, study, shifts)]
    members.sort(key=lambda member: (member.values["finger"] == FULL, "shift_mm" in member.values))
    scans = run_all(members, folder, jobs=jobs)
    fingers = {name: Finger(study, {}) for name, study in studies.items()}
    for member, scan in zip(members, scans, strict=True):
        fingers[str(member.values["finger"])].scans[member.name.partition("-")[2]] = scan
    print_table(list(decays(fingers["reproduction"], fingers[FULL])))
    print_fit(fingers["reproduction"])
    rows = list(table(*fingers.values()))
    print_table(rows)
    write_table(folder / "hamasaki2020.csv", rows)
    keep(folder / "hamasaki2020.npz", fingers["reproduction"], fingers[FULL])
    for name, figure in figures(fingers).items():
        figure.savefig(folder / f"paper_{name}.png", dpi=110)
    sections(fingers["reproduction"], folder / "paper_sections.png")


# %%
def members_of(name: str, study: Study, shifts: tuple[float, ...]) -> Iterator[Member]:
    """Yield the scans of a finger: the letters, shifted letters and, if it is coarse, presses."""
    stem = name.replace(" ", "_")
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
    yield Member(f"{stem}-letters", study, {"finger": name})
    for key, (body, protocol) in () if name == FULL else presses.items():
        one = press.model_copy(update={"stimulus": body, "protocol": protocol})
        yield Member(f"{stem}-{key}", one, {"finger": name})
    for shift in filter(None, shifts):
        body = study.stimulus.model_copy(update={"shift_mm": (shift, 0.0)})
        coarser = study.protocol.model_copy(update={"output_mm": PASS_MM})
        one = study.model_copy(update={"stimulus": body, "protocol": coarser})
        yield Member(f"{stem}-letters{shift:+g}", one, {"finger": name, "shift_mm": shift})


def decays(finger: Finger, full: Finger) -> Iterator[Row]:
    """Yield, for each decay, the fit to the cylinders and the bundles."""
    for decay in DECAYS_S:
        found = finger.fitted_neuron(decay)
        fitted, fitted_full = (one.with_neuron(found.neuron) for one in (finger, full))
        gain, kappa = (one.value for one in found.estimates.values())
        yield {
            "decay, ms": f"{1e3 * decay:g}",
            "gain, kappa": f"{gain:.3g}, {kappa:.3f}",
            "ramp; hold, /s": "; ".join(map(numbers, fitted.rates_Hz().T)),
            "rms, /s": f"{misfit_Hz(found):.1f}",
            "bundles": bundles(fitted.middle(), spikes=True),
            FULL: bundles(fitted_full.middle(), spikes=True),
        }


def print_fit(finger: Finger) -> None:
    """Print the constants that the assumed rates under the cylinders give, and the study's."""
    for name, estimate in finger.fitted_neuron().estimates.items():
        print(f"{name} {estimate.value:.4g}, in the study {getattr(finger.study.neuron, name):g}")


def keep(path: Path, finger: Finger, full: Finger) -> None:
    """Write what the middle receptors and those under the cylinders feel, for work on neurons."""
    found = {
        f"cylinder_{c}": np.column_stack(one)
        for c, one in zip(CURVATURES, finger.cylinders(), strict=True)
    }
    for name, one in (("coarse", finger), ("full_size", full)):
        found[name] = np.column_stack(one.middle_history())
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(
            stream, **{key: array.astype(np.float32) for key, array in found.items()}
        )


# %%
def table(*fingers: Finger) -> Iterator[Row]:
    """Yield the rows in the order of the paper's figures."""

    def row(figure: str, paper: str, say: Callable[[Finger], str], needs: str = "letters") -> Row:
        said = {
            name: say(finger) if needs in finger.scans else "-"
            for name, finger in zip(("reproduction", FULL, "default"), fingers, strict=True)
        }
        return {"figure": figure, "paper": paper, **said}

    yield row("", "81,000 tetrahedra", lambda f: f"{len(f.study.finger.mesh().cells):,}")
    yield row("", "letters: 0.6 N at 1.97 mm", lambda f: f"{f.pressed_N():.3f} N")
    yield row("3a", f"plate: {numbers(PLATE.mean, 3)} N (measured)", plate_forces, "plate")
    yield row("3b", "profile beside a sharp edge", edge_profile, "edge")
    yield row("3b", "profile under a cylinder of 3.17 mm (measured)", profile_r2, "cylinder")
    pressed = f"cylinder-{CURVATURES[0]}"
    yield row("5, 6", "ramp: rises with curvature", lambda f: per_s(f.rates_Hz()[:, 0]), pressed)
    yield row("5, 6", "hold: likewise", lambda f: per_s(f.rates_Hz()[:, 1]), pressed)
    yield row("8a", "three maxima of SED", lambda f: maxima(f.middle()))
    yield row("8a", "at each, an edge below the receptor", edges)
    yield row("8b", f"bundles: {places(BUNDLES_MM)}", lambda f: bundles(f.middle()))
    yield row("8b", f"{places(BUNDLES_MM)}: high rates", lambda f: in_windows(f, BUNDLES_MM))
    yield row("8b", f"{places(BETWEEN_MM)}: not stated", lambda f: in_windows(f, BETWEEN_MM))
    yield row("8b", "high rates until each maximum", about_maxima)
    yield row("9a", "0 to 5 mm: central rows first", lambda f: first_rows(f, (0.0, 5.0)))
    yield row("9a", "5 to 10 mm: outer rows first", lambda f: first_rows(f, (5.0, 10.0)))
    yield row("9a", "outer rows fire less", sparseness)
    yield row("9a", "population: fires over the gap", lambda f: gap(f, f.population()))
    yield row("9b", "one fibre: hardly fires there", lambda f: gap(f, f.fibre()))
    yield row("9a", "population", lambda f: image_numbers(f, f.population(half_width_of(f))))
    yield row("9b", "one fibre, the same places", lambda f: image_numbers(f, f.fibre()))


def print_table(rows: Sequence[Row]) -> None:
    """Print rows, all with the same columns."""
    print(f"\n| {' | '.join(rows[0])} |\n|{' --- |' * len(rows[0])}")
    for row in rows:
        print(f"| {' | '.join(row.values())} |")


def numbers(values: Iterable[float], digits: int = 0) -> str:
    """Return numbers as a table writes them."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def places(windows_mm: Iterable[tuple[float, float]]) -> str:
    """Return parts of the slide."""
    return ", ".join(f"{start:.1f} to {end:.1f}" for start, end in windows_mm) + " mm"


def per_s(rates: Iterable[float]) -> str:
    """Return rates."""
    return f"{numbers(rates)}/s"


def plate_forces(finger: Finger) -> str:
    """Return the plate's forces and how many standard deviations they are off."""
    force = np.interp(PLATE.depth_mm, *finger.plate())
    off = ", ".join(f"{value:+.1f}" for value in (force - PLATE.mean) / PLATE.sd)
    return f"{numbers(force, 3)} N ({off} sd)"


def edge_profile(finger: Finger) -> str:
    """Return the skin's deflection beside the sharp edge."""
    return f"{numbers(finger.profile('edge', BESIDE_MM), 2)} mm at 1, 2, 3, 4 mm"


def profile_r2(finger: Finger) -> str:
    """Return how well the profile under a cylinder agrees with the measured one."""
    return f"R² {r_squared(finger.profile('cylinder', PROFILE.place_mm), PROFILE.mean):.3f}"


# %%
def maxima(seen: Middle) -> str:
    """Return where SED has maxima and how large they are."""
    highs = seen.maxima()
    return f"{numbers(seen.along_mm[highs], 1)} mm ({numbers(seen.sed_kPa[highs], 1)} kPa)"


def edges(finger: Finger) -> str:
    """Return how far the nearest edge is at each maximum of SED."""
    seen = finger.middle()
    away = [finger.to_edge_mm(place) for place in seen.along_mm[seen.maxima()]]
    return f"{numbers(away, 1)} mm away"


def bundles(seen: Middle, *, spikes: bool = False) -> str:
    """Return where the bundles are, and how many spikes they have."""
    found = seen.bundles()
    if not spikes:
        return places((one.start_s, one.end_s) for one in found)
    return ", ".join(f"{one.start_s:.1f} to {one.end_s:.1f} ({one.spikes})" for one in found)


def in_windows(finger: Finger, windows_mm: Iterable[tuple[float, float]]) -> str:
    """Return the middle afferent's rates in windows of the slide."""
    return per_s(finger.middle().rates_Hz(finger.study.protocol.speed_mm_s, windows_mm))


def about_maxima(finger: Finger) -> str:
    """Return the middle afferent's rates before and after the maxima of SED."""
    before, after = finger.middle().beside_maxima_Hz(finger.study.protocol.speed_mm_s)
    return f"{per_s(before)} in 0.8 mm before, {per_s(after)} after"


# %%
def first_rows(finger: Finger, ends_mm: tuple[float, float]) -> str:
    """Return where central and outer rows first have high rates, and how many of them do."""
    image = finger.population()
    first = first_high_mm(image, finger.study.protocol.speed_mm_s, ends_mm)
    said = []
    for name, ends in (("central", CENTRAL_MM), ("outer", OUTER_MM)):
        own = first[rows_of(image, ends)]
        found = own[np.isfinite(own)]
        place = f"{np.median(found):.1f} mm" if len(found) else "never"
        said.append(f"{name} {place} ({len(found)} of {len(own)} rows)")
    return ", ".join(said)


def sparseness(finger: Finger) -> str:
    """Return the mean numbers of spikes of central and outer rows."""
    image = finger.population()
    counts = image.response.counts()
    central, outer = (counts[rows_of(image, ends)].mean() for ends in (CENTRAL_MM, OUTER_MM))
    return f"{outer:.0f} spikes a row, central {central:.0f}"


def gap(finger: Finger, image: RateImage) -> str:
    """Return the rates over the G's gap and over the strokes beside it."""
    within, beside = finger.gap_Hz(image)
    return f"{within:.0f}/s, strokes beside it {beside:.0f}/s"


def half_width_of(finger: Finger) -> float:
    """Return the largest distance from the middle that one fibre's rows have."""
    return float(np.abs(finger.fibre().across_mm).max())


def image_numbers(finger: Finger, image: RateImage) -> str:
    """Return rows, spikes and likeness to the letters of a raster."""
    spikes = image.response.counts().sum()
    likeness = image.outline_correlation(finger.study.stimulus)
    return f"{len(image.across_mm)} rows, {spikes:,} spikes, r {likeness:.2f}"


# %%
if __name__ == "__main__":
    run_script(main)
