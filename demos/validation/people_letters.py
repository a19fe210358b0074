# %% [markdown]
# # Letters under many fingers: what holds in most people?
#
# Figures of one finger say that one fibre shows the letter G more clearly than a population, that
# round letters are alike, and what friction does to them. Is each larger than what differs between
# people? Here the same people (`tactile_fem.study.People`) feel a G in one pass and in many, four
# other letters, and a G without friction and with much of it, and are compared with themselves.
# Friction is that of the condition in all of them.
#
#     python demos/validation/people_letters.py results/people_letters --number 8
#
# Expected time: 3 hours on two cores; started again it goes on. Options of a study follow, such as
# `protocol.depth_mm=1.5`.

# %%
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem import Results, Study, load_study, run_script, write_table
from tactile_fem.errors import StudyError
from tactile_fem.people import Ensemble, people, run_people
from tactile_fem.people.bands import bands, bands_table
from tactile_fem.people.paired import paired
from tactile_fem.runtime.files import write_figure
from tactile_fem.series import (
    Member,
    RateImage,
    correlations,
    fibre_image,
    numbers_of,
    population_image,
    single_fibre,
)
from tactile_fem.study import People

Array = NDArray[np.float64]

ROUND, OTHER = "GCOQ", "H"
LETTERS = ROUND + OTHER
FRICTION = {"friction-0": 0.0, "text-G": 0.3, "friction-1": 1.0}
# Receptors of the population; each second one has a pass of one fibre in the same row.
SPACING_MM, HALF_WIDTH_MM = 0.5, 4.0
ROW_MM = 2 * SPACING_MM
SHIFT_MM = 1.0  # of an image over another, at most
# Of a reader who knows half of all letters, see demos/gallery/alphabet.py: there in rows at 0.2 mm,
# here as much for each square millimetre.
NOISE_HZ, READINGS, SEED = 630.0 * (0.2 / SPACING_MM) ** 0.5, 200, 1


# %%
def base(changes: Sequence[str] = ()) -> Study:
    """Return the scan of a G; friction does not vary between people."""
    places = [f"receptors.half_width_mm={HALF_WIDTH_MM}", f"receptors.spacing_mm={SPACING_MM}"]
    study = load_study(overrides=["stimulus.text=G", "protocol.output_mm=0.2", *places, *changes])
    return study.model_copy(update={"people": People(fixed=("stimulus.friction",))})


def conditions(study: Study) -> list[Member]:
    """Return what each person feels."""
    passes = single_fibre(study, spacing_mm=ROW_MM, half_width_mm=HALF_WIDTH_MM)
    return [
        *(Member(f"text-{letter}", felt(study, text=letter), {}) for letter in LETTERS),
        *(replace(one, values={}) for one in passes if one.values["shift_mm"]),
        *(
            Member(name, felt(study, friction=friction), {})
            for name, friction in FRICTION.items()
            if name != "text-G"
        ),
    ]


def felt(study: Study, **changes: str | float) -> Study:
    """Return the study with another stimulus."""
    stimulus = study.stimulus.model_copy(update=changes)
    return study.model_copy(update={"stimulus": stimulus})


# %%
def main(folder: Path, *changes: str, number: int = 8, jobs: int = 2) -> None:
    """Scan letters under the fingers of many people, and compare each person's with one another.

    Parameters
    ----------
    folder
        Folder for scans, tables and the figure.
    changes
        Changes of the study: section.key=value.
    number
        Number of people.
    jobs
        Parallel scans.
    """
    each = conditions(base(changes))
    run_people(people(each, number), folder / "scans", jobs=jobs)
    whole = Ensemble.open(folder / "scans")
    for name, reason in whole.failed.items():
        print(f"{name} is missing: {reason}")
    likeness = one_or_many(of(whole, [c for c in whole.conditions if is_pass(c)]))
    images = letter_images(of(whole, [f"text-{letter}" for letter in LETTERS]))
    rubbed = friction_numbers(of(whole, FRICTION))
    tell_likeness(likeness)
    shares = tell_letters(images)
    tell_friction(folder, rubbed)
    write_figure(folder / "people_letters.png", draw(likeness, shares, rubbed))


def is_pass(condition: str) -> bool:
    """Return whether a condition is a pass of the G; that without a shift is the population's."""
    return condition == "text-G" or condition.startswith("shift")


def of(whole: Ensemble, names: Sequence[str] | Mapping[str, float]) -> Ensemble:
    """Return an ensemble of some conditions: people who miss others are complete in it."""
    return replace(whole, conditions=tuple(names))


# %% [markdown]
# One fibre or many: the correlation of the image of firing with the letter's outline. Both images
# have the same rows, so that neither is finer.


# %%
def one_or_many(ensemble: Ensemble) -> dict[str, Array]:
    """Return the correlation of each person's images with the outline, (people,) each."""
    stimulus = ensemble.results("text-G")[0].study.stimulus
    passes = zip(*(ensemble.results(name) for name in ensemble.conditions), strict=True)
    fibres = [fibre_image(own) for own in passes]
    populations = [sparse(population_image(one)) for one in ensemble.results("text-G")]
    return {
        "population": np.array([image.outline_correlation(stimulus) for image in populations]),
        "one fibre": np.array([image.outline_correlation(stimulus) for image in fibres]),
    }


def sparse(image: RateImage) -> RateImage:
    """Return every row of an image that a pass has too."""
    rows = np.abs(image.across_mm / ROW_MM - np.rint(image.across_mm / ROW_MM)) < 1e-6
    return replace(image, across_mm=image.across_mm[rows], rate_Hz=image.rate_Hz[rows])


def tell_likeness(likeness: Mapping[str, Array]) -> None:
    """Print how like the letter both images are."""
    print_rows(bands_table({f"correlation with the G, {name}": r for name, r in likeness.items()}))
    print(f"one fibre after population: {paired(*likeness.values())}")


# %% [markdown]
# Letters: how alike are the images of firing within people, and what does a reader take them for
# who knows the mean images of all *other* people?


# %%
def letter_images(ensemble: Ensemble) -> Array:
    """Return firing rates in spikes/s, (people, letters, rows, columns)."""
    found = [
        [population_image(one).rate_Hz for one in ensemble.results(name)]
        for name in ensemble.conditions
    ]
    columns = min(image.shape[1] for own in found for image in own)
    cut = [[image[:, :columns] for image in own] for own in found]
    return np.array(cut).swapaxes(0, 1)


def alike(images: Array) -> Array:
    """Return the correlations of each person's letters, (people, letters, letters)."""
    return np.array([correlations(own, own, _shifts()) for own in images])


def read(images: Array, noise_Hz: float = NOISE_HZ) -> Array:
    """Return how often a letter (row) is taken for another (column), (people, letters, letters).

    Raises
    ------
    StudyError
        There is nobody else to know the letters of.
    """
    if len(images) < 2:
        raise StudyError("Reading needs two people or more whose scans are complete.")
    random, (count, letters) = np.random.default_rng(SEED), images.shape[:2]
    shares = np.zeros((count, letters, letters))
    written = np.repeat(np.arange(letters), READINGS if noise_Hz else 1)
    for k, own in enumerate(images):
        templates = np.delete(images, k, axis=0).mean(axis=0)
        seen = own[written] + noise_Hz * random.standard_normal((len(written), *own.shape[1:]))
        np.add.at(shares[k], (written, correlations(seen, templates, _shifts()).argmax(axis=1)), 1)
    return shares * letters / len(written)


def _shifts() -> tuple[int, int]:
    return round(SHIFT_MM / SPACING_MM), round(SHIFT_MM / 0.2)  # columns are 0.2 mm apart


def tell_letters(images: Array) -> Array:
    """Print how alike letters are and how they are read; return the shares of the reader."""
    r, n = alike(images), len(ROUND)
    pairs = {
        f"{LETTERS[i]} and {LETTERS[k]}": (r[:, i, k] + r[:, k, i]) / 2
        for i, k in combinations(range(len(LETTERS)), 2)
    }
    inside = np.mean([own for name, own in pairs.items() if OTHER not in name], axis=0)
    outside = np.mean([own for name, own in pairs.items() if OTHER in name], axis=0)
    print_rows(bands_table({f"correlation of {name}": own for name, own in pairs.items()}))
    print(f"{', '.join(ROUND)} among themselves after with {OTHER}: {paired(outside, inside)}")
    sure = np.einsum("kii->ki", read(images, noise_Hz=0.0))
    print(f"known without noise: {100 * sure.mean():.0f} %")
    shares = read(images)
    known = np.einsum("kii->ki", shares)
    among = (shares[:, :n, :n].sum(axis=(1, 2)) - known[:, :n].sum(axis=1)) / n
    numbers = {f"{letter} known (%)": 100 * known[:, k] for k, letter in enumerate(LETTERS)}
    numbers[f"{ROUND} taken for one another (%)"] = 100 * among
    print_rows(bands_table(numbers))
    return shares


# %% [markdown]
# Friction: forces, strain energy density, firing and correlation at three coefficients.


# %%
def friction_numbers(ensemble: Ensemble) -> dict[float, dict[str, Array]]:
    """Return the numbers of each person, (people,) each, by friction."""
    found = {}
    for name in ensemble.conditions:
        each = [numbers_with_likeness(one) for one in ensemble.results(name)]
        found[FRICTION[name]] = {key: np.array([own[key] for own in each]) for key in each[0]}
    return found


def numbers_with_likeness(scan: Results) -> dict[str, float]:
    """Return forces, SED, spikes, and what the image of firing is like."""
    numbers, image = numbers_of(scan), population_image(scan)
    firing = image.rate_Hz.sum(axis=0)
    return {
        "normal force (N)": numbers["normal_N"],
        "tangential over normal": numbers["tangential_N"] / numbers["normal_N"],
        "largest SED (kPa)": numbers["largest_sed_kPa"],
        "spikes": numbers["spikes"],
        "middle of firing (mm)": float(firing @ image.along_mm / max(firing.sum(), 1e-9)),
        "correlation with the outline": image.outline_correlation(scan.study.stimulus),
    }


def tell_friction(folder: Path, rubbed: Mapping[float, Mapping[str, Array]]) -> None:
    """Print and write the table, and what more friction does within people."""
    table = [["friction", *bands_table(next(iter(rubbed.values())))[0]]]
    for friction, numbers in rubbed.items():
        table += [[f"{friction:g}", *row] for row in bands_table(numbers)[1:]]
    print_rows(table)
    write_table(
        folder / "friction.csv", [dict(zip(table[0], row, strict=True)) for row in table[1:]]
    )
    each = list(rubbed.items())
    for (low, before), (high, after) in pairwise(each):
        for name in before:
            print(f"friction {high:g} after {low:g}, {name}: {paired(before[name], after[name])}")


def print_rows(rows: Sequence[Sequence[str]]) -> None:
    """Print a table, its heading first."""
    for row in [rows[0], ["---"] * len(rows[0]), *rows[1:]]:
        print(f"| {' | '.join(row)} |")
    print(flush=True)


# %%
def draw(
    likeness: Mapping[str, Array], shares: Array, rubbed: Mapping[float, Mapping[str, Array]]
) -> Figure:
    """Draw the correlations of both images, what letters are taken for, and what friction does."""
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    many, letters, sed, drag = figure.subplots(1, 4)
    _lines(many, np.array(list(likeness.values())), list(likeness))
    many.set(ylabel="Correlation with the outline", ylim=(0, 1))
    shown = letters.imshow(100 * shares.mean(axis=0), cmap="magma", vmin=0, vmax=100)
    for (row, column), share in np.ndenumerate(100 * shares.mean(axis=0)):
        shade = "k" if share > 60 else "w"
        letters.text(column, row, f"{share:.0f}", ha="center", va="center", color=shade, size=8)
    letters.set_xticks(range(len(LETTERS)), LETTERS)
    letters.set_yticks(range(len(LETTERS)), LETTERS)
    letters.set(xlabel="Read as (% of readings)", ylabel="Letter")
    figure.colorbar(shown, ax=letters, location="top", shrink=0.8)
    for axes, name in ((sed, "largest SED (kPa)"), (drag, "correlation with the outline")):
        values = np.array([numbers[name] for numbers in rubbed.values()])
        _lines(axes, values, [f"{friction:g}" for friction in rubbed])
        axes.set(xlabel="Friction", ylabel=name[0].upper() + name[1:], ylim=(0, None))
    return figure


def _lines(axes, values: Array, names: Sequence[str]) -> None:
    """Draw a line for each person, values (conditions, people), and the median."""
    axes.plot(values, color="C0", alpha=0.4, lw=0.8, marker="o", ms=3)
    axes.plot(bands(values.T).median, color="k", lw=2, marker="o")
    axes.set_xticks(range(len(names)), names)
    axes.margins(x=0.2)


# %%
if __name__ == "__main__":
    run_script(main)
