# %% [markdown]
# # What contact mechanics buys: the letters over an elastic half-space
#
# Hamasaki et al. 2020 (DOI 10.1177/1687814020984651) say that models before theirs moved point
# loads over a half-space: no layers, no friction, no contact that changes. This script repeats the
# letters with three models and fires the same neuron, that of the study "hamasaki2020", with gain
# and adaptation fitted anew to the same rates under the same cylinders:
#
# - **finger**: the reproduction, by finite elements.
# - **Hertz**: an incompressible half-space. The pad's curvature enters as the gap before contact;
#   in each step pressures are found that do not pull. No friction.
# - **shifted load**: the pressures under the letters on flat skin, the G's adding up to 0.6 N,
#   moved along with them. On flat skin pressures do not change with the place, so they are found
#   once. The neuron is that of Hertz: a cylinder has no finite force on flat skin.
#
# Young's modulus is chosen for 0.6 N at 1.97 mm with Hertz; steps and depths are the finger's.
# Receptors lie as deep as in the finger, 0.82 mm.
#
#     python demos/validation/half_space.py results/paper --jobs 2
#
# With the folder of `hamasaki2020.py` it reads the scans that are there; it adds H and Q with their
# neighbours, and frictions of 0 and 0.6: four scans, three minutes. Half-spaces take four minutes.

# %%
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from boussinesq import HalfSpace
from hamasaki2020 import (
    Row,
    about_maxima,
    bundles,
    first_rows,
    gap,
    maxima,
    members_of,
    per_s,
    print_table,
    sparseness,
)
from hamasaki2020_figures import TICKS, raster
from hamasaki2020_readings import Array, Finger, Middle, misfit_Hz
from matplotlib.figure import Figure
from scipy.interpolate import make_interp_spline

from tactile_fem import Study, load_study, run_script, write_table
from tactile_fem.output import draw_spikes
from tactile_fem.results.histories import DISPLACEMENT
from tactile_fem.series import Member, RateImage, run_all
from tactile_fem.stimulus.sampled import height_map
from tactile_fem.study import Neuron, Output

FORCE_N = 0.6
TEXTS = {"G": "FGH", "H": "GHI", "Q": "PQR"}  # the letter in the middle is scanned whole
SHIFTS_MM = (-2.0, 0.0, 2.0)
FRICTIONS = (0.0, 0.3, 0.6)
HALF_MM, FLAT_HALF_MM, FLAT_MIDDLE_MM, FLAT_DEPTH_MM = (6.5, 11.0), (6.5, 15.0), 5.0, 0.5
CELL_MM = 0.1
REACH_MM = 14.0  # of the letters' slide and a border
ROW_MM, LATEST_MM = 0.2, 1.0
COLOURS = {"finger": "#0072B2", "Hertz": "#009E73", "shifted load": "#CC79A7"}


# %%
def main(folder: Path, *, jobs: int = 1) -> None:
    """Scan what is missing in the folder, press the half-spaces, print the table and draw."""
    study = load_study("hamasaki2020")
    members = list(members_of_letters(study))
    scans = dict(
        zip([one.name for one in members], run_all(members, folder, jobs=jobs), strict=True)
    )
    own = {name.partition("-")[2]: scan for name, scan in scans.items()}
    finger = Finger(study, own)
    modulus = FORCE_N / Hertz(study, 1.0).force_N(study.protocol.depth_mm)
    print(f"Young's modulus {1e3 * modulus:.1f} kPa: {FORCE_N} N at {study.protocol.depth_mm} mm")
    models = {"finger": finger, **half_spaces(study, own, modulus)}
    for name, model in models.items():
        found = model.fitted_neuron()
        gain, kappa = (one.value for one in found.estimates.values())
        rms = misfit_Hz(found)
        print(f"{name}: gain {gain:.3g} pA/kPa, kappa {kappa:.3f}, rms {rms:.0f}/s")
        models[name] = model.with_neuron(found.neuron)
    rows = list(table(models))
    print_table(rows)
    write_table(folder / "half_space.csv", rows)
    drawn(models).savefig(folder / "paper_half_space.png", dpi=110)


def members_of_letters(study: Study) -> Iterator[Member]:
    """Yield the scans of the finger that are compared; those of `hamasaki2020.py` are its own."""
    for one in members_of("reproduction", study, SHIFTS_MM):
        if "letters" in one.name or one.name.rpartition("-")[2].isdigit():
            yield one
    study = study.model_copy(update={"neuron": Neuron(), "output": Output(pictures=False)})
    others = {letter: {"text": text} for letter, text in TEXTS.items() if letter != "G"}
    others |= {f"friction {value:g}": {"friction": value} for value in FRICTIONS if value != 0.3}
    for name, values in others.items():
        body = study.stimulus.model_copy(update=values)
        stem = name.replace(" ", "_")
        yield Member(f"reproduction-{stem}", study.model_copy(update={"stimulus": body}), values)


def half_spaces(
    study: Study, scans: Mapping[str, Scan], modulus_MPa: float, cell_mm: float = CELL_MM
) -> dict[str, Finger]:
    """Return the two half-spaces, with the scans of the finger, friction aside."""
    hertz, shifted = (
        partial(model, modulus_MPa=modulus_MPa, cell_mm=cell_mm) for model in (Hertz, ShiftedLoad)
    )
    alike = {name: scan for name, scan in scans.items() if "friction" not in name}
    presses = {name: scan for name, scan in alike.items() if "cylinder" in name}
    pressed = {name: felt_in(hertz, scan) for name, scan in alike.items()}
    moved = {name: felt_in(shifted, scan) for name, scan in alike.items() if name not in presses}
    cylinders = {name: pressed[name] for name in presses}
    return {"Hertz": Finger(study, pressed), "shifted load": Finger(study, moved | cylinders)}


# %%
class Scan(NamedTuple):
    """What `Finger` reads of a scan."""

    study: Study
    trace: Mapping[str, Array]


def felt_in(model: Callable[[Study], Hertz | ShiftedLoad], scan: Scan) -> Scan:
    """Return a scan with what receptors feel in another model."""
    kept = ("time_s", "depth_mm", "displacement_mm", "receptors_mm", "population")
    trace = {key: scan.trace[key] for key in kept}
    return Scan(scan.study, {**trace, "sed_kPa": model(scan.study).felt(trace)})


def receptor_depth_mm(study: Study) -> float:
    """Return how deep receptors lie, between epidermis and dermis."""
    return study.finger.stratum_corneum_mm + study.finger.epidermis_mm


class Hertz:
    """A pad of two curvatures as a half-space; pressures follow the body."""

    def __init__(self, study: Study, modulus_MPa: float, cell_mm: float = CELL_MM) -> None:
        self.space = HalfSpace(modulus_MPa, HALF_MM, cell_mm)
        self.receptor_mm = receptor_depth_mm(study)
        x, y = self.space.places_mm
        finger = study.finger
        across, along = x**2 / (2 * finger.palmar_height_mm), y**2 / (2 * finger.pad_radius_mm)
        self._form = across[:, None] + along
        lengthened = np.arange(y[0], y[-1] + REACH_MM, self.space.cell_mm)
        heights = height_map(study.stimulus.body(), x, lengthened)
        self._heights = make_interp_spline(lengthened, heights, k=1, axis=1)
        self._touch_mm = (self._form - self._heights(y)).min()
        self._pressure: Array | None = None

    def pressures_MPa(self, depth_mm: float, displacement_mm: float) -> Array:
        """Return the pressures with the body so deep past the first touch, and so far along."""
        y = self.space.places_mm[1]
        gap_mm = self._form - self._heights(y + displacement_mm) - self._touch_mm
        self._pressure = self.space.pressures_MPa(gap_mm, depth_mm, self._pressure)
        return self._pressure

    def force_N(self, depth_mm: float) -> float:
        """Return the force at a depth before the slide."""
        return self.space.force_N(self.pressures_MPa(depth_mm, 0.0))

    def felt(self, trace: Mapping[str, Array]) -> Array:
        """Return the SED of receptors on Y = 0 at the steps of a scan, (steps, receptors)."""
        x, y = self.space.places_mm
        middle, found = len(y) // 2, []
        for depth, along in zip(trace["depth_mm"], trace["displacement_mm"], strict=True):
            pressure = self.pressures_MPa(depth, along)
            below = self.space.sed_kPa(pressure, self.receptor_mm)[:, middle]
            found.append(np.interp(trace["receptors_mm"][:, 0], x, below))
        return np.array(found)


class ShiftedLoad:
    """The pressures under letters on flat skin, found once and moved along."""

    def __init__(self, study: Study, modulus_MPa: float, cell_mm: float = CELL_MM) -> None:
        space = HalfSpace(modulus_MPa, FLAT_HALF_MM, cell_mm)
        self.x, self.y = space.places_mm[0], space.places_mm[1] + FLAT_MIDDLE_MM
        relief = study.stimulus.relief_mm
        heights = height_map(study.stimulus.body(), self.x, self.y)
        gap_mm = np.where(heights > -0.9 * relief, -heights, np.inf)
        pressure = space.pressures_MPa(gap_mm, FLAT_DEPTH_MM)
        of_middle = pressure * (np.abs(space.places_mm[1]) < study.stimulus.pitch_mm / 2)
        pressure *= FORCE_N / space.force_N(of_middle)
        self.sed_kPa = space.sed_kPa(pressure, receptor_depth_mm(study))

    def felt(self, trace: Mapping[str, Array]) -> Array:
        """Return the SED of receptors on Y = 0 at the steps of a scan, (steps, receptors).

        The load rises with the depth: SED with its square.
        """
        at_rows = make_interp_spline(self.x, self.sed_kPa, k=1)(trace["receptors_mm"][:, 0])
        along = make_interp_spline(self.y, at_rows, k=1, axis=1)(trace["displacement_mm"])
        share = trace["depth_mm"] / trace["depth_mm"].max()
        return share[:, None] ** 2 * along.T


# %%
def table(models: Mapping[str, Finger]) -> Iterator[Row]:
    """Yield what the models give, one statement a row."""
    finger = models["finger"]
    recorded, seen = finger.population(), finger.middle()

    def row(what: str, say: Callable[[Finger], str]) -> Row:
        return {"": what, **{name: say(model) for name, model in models.items()}}

    yield row("ramp under 16, 8, 4, 2 per inch", lambda f: per_s(f.rates_Hz()[:, 0]))
    yield row("hold", lambda f: per_s(f.rates_Hz()[:, 1]))
    yield row("maxima of SED", lambda f: maxima(f.middle()))
    yield row("SED over the slide, r with the finger", lambda f: alike(f.middle(), seen))
    yield row("bundles", lambda f: bundles(f.middle()))
    yield row("rates about the maxima", about_maxima)
    yield row("spikes of the population", lambda f: f"{f.population().response.counts().sum():,}")
    yield row("raster, r with the finger", lambda f: f"{image_r(f.population(), recorded):.2f}")
    yield row("G, population: r with its outline", lambda f: likeness(f, "letters"))
    yield row("G, one fibre", lambda f: to_outline(f, f.fibre()))
    yield row("H", lambda f: likeness(f, "H"))
    yield row("Q", lambda f: likeness(f, "Q"))
    yield row("gap, population", lambda f: gap(f, f.population()))
    yield row("gap, one fibre", lambda f: gap(f, f.fibre()))
    yield row("0 to 5 mm", lambda f: first_rows(f, (0.0, 5.0)))
    yield row("5 to 10 mm", lambda f: first_rows(f, (5.0, 10.0)))
    yield row("outer rows", sparseness)
    for friction in FRICTIONS:
        yield row(f"friction {friction:g}", lambda f, mu=friction: rubbed(f, mu))


def letter(finger: Finger, name: str) -> Finger:
    """Return the finger with one of its scans as that of the letters."""
    scan = finger.scans[name]
    study = finger.study.model_copy(update={"stimulus": scan.study.stimulus})
    return Finger(study, {"letters": scan})


def likeness(finger: Finger, name: str) -> str:
    """Return the population's correlation with the outline of the letters of a scan."""
    one = letter(finger, name)
    return to_outline(one, one.population())


def to_outline(finger: Finger, image: RateImage) -> str:
    """Return the correlation of an image with the outline of the letters."""
    return f"{image.outline_correlation(finger.study.stimulus):.2f}"


def alike(seen: Middle, other: Middle) -> str:
    """Return the correlation of the middle receptor's SED with another's."""
    felt = np.interp(other.along_mm, seen.along_mm, seen.sed_kPa)
    return f"{np.corrcoef(felt, other.sed_kPa)[0, 1]:.2f}"


def image_r(image: RateImage, other: RateImage) -> float:
    """Return the correlation of two rasters' rates, the largest over a delay."""
    return max(
        float(
            np.corrcoef(image.rate_Hz[:, : -k or None].ravel(), other.rate_Hz[:, k:].ravel())[0, 1]
        )
        for k in range(round(LATEST_MM / ROW_MM))
    )


def rubbed(finger: Finger, friction: float) -> str:
    """Return what the letters do with another friction."""
    name = "letters" if friction == 0.3 else f"friction_{friction:g}"
    if name not in finger.scans:
        return "as with 0.3"
    one = letter(finger, name)
    image = one.population()
    spikes = image.response.counts().sum()
    return f"{maxima(one.middle())}, {spikes:,} spikes, r {to_outline(one, image)}"


# %%
def drawn(models: Mapping[str, Finger]) -> Figure:
    """Draw the rasters of G, H and Q, and the middle receptor's SED and spikes under the G."""
    figure = Figure(figsize=(9, 11.5), layout="constrained")
    grid = figure.add_gridspec(4, 3, height_ratios=(3, 3, 3, 2.4))
    for k, (name, model) in enumerate(models.items()):
        for j, shown in enumerate(TEXTS):
            scan = "letters" if shown == "G" else shown
            axes, one = figure.add_subplot(grid[j, k]), letter(model, scan)
            image = one.population()
            raster(axes, image, one)
            axes.set_title(f"{name}, {shown}: r {to_outline(one, image)}")
            axes.set(xlabel="" if j < 2 else DISPLACEMENT, ylabel="" if k else "X (mm)")
    below = grid[3, :].subgridspec(2, 1, height_ratios=(3, 1), hspace=0)
    sed, fired = (figure.add_subplot(one) for one in below)
    for k, (name, model) in enumerate(models.items()):
        seen = model.middle()
        sed.plot(seen.along_mm, seen.sed_kPa, color=COLOURS[name], label=name)
        (spikes_mm,) = seen.fired.spikes
        draw_spikes(fired, spikes_mm, np.full(len(spikes_mm), -k), color=COLOURS[name], **TICKS)
    sed.set(ylabel="SED (kPa)", xlim=(0, 10), ylim=(0, None), xticklabels=[])
    sed.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.42, 1.0))
    fired.set(xlabel=f"{DISPLACEMENT}: the middle receptor under the G", xlim=(0, 10), yticks=[])
    fired.set_ylim(0.5 - len(models), 0.5)
    return figure


# %%
if __name__ == "__main__":
    run_script(main)
